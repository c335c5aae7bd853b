"""Folders of assets, each under a name that every file system keeps apart from others."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

APART = re.compile(r"~((?:[0-9a-f]{2})+)")


def folder_of(asset: str) -> str:
    """The asset's name, but for the two that a file system keeps for itself; `~` is not allowed in a name."""
    return f"~{asset}" if asset in (".", "..") else asset


def folder_in(parent: Path, asset: str) -> Path:
    """The folder of an asset, which is made where there is none. Where the file system gives its name to another asset
    (`Press` and `press`) or to none (`CON`, `x.`), as shares of Windows do, it is that of the name's bytes in digits.
    """
    own, apart = parent / folder_of(asset), parent / f"~{asset.encode().hex()}"
    with suppress(OSError):
        own.mkdir()
    if own.name in os.listdir(parent):  # a folder of another name may say that it is there, too
        return own
    apart.mkdir(exist_ok=True)
    return apart


def asset_of_folder(folder: str) -> str:
    """The asset of a folder's name."""
    apart = APART.fullmatch(folder)
    return bytes.fromhex(apart[1]).decode(errors="replace") if apart else folder.removeprefix("~")

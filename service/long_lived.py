"""What a start loads and restores stays as long as the process: the collector of garbage need not look through it.

With 200 assets the collector takes a sixth of a start otherwise, and stops all threads for 0.3 s now and then.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def long_lived() -> Iterator[None]:
    """No garbage is looked for inside; what is there at the end is left out for good, until `gc.unfreeze`."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

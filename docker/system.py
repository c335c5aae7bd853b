"""Puts Debian's Python and the libraries that it needs into a folder:   python3 system.py FOLDER BYTE-CODE [EXTRA]

The folder is to be the root of an image. The files are those of Debian's packages, and the byte code that the file
BYTE-CODE names; the list of installed packages goes along, for scanners of known faults.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PACKAGES = (
    "base-files", "ca-certificates", "libbz2-1.0", "libc6", "libcrypt1", "libexpat1", "libffi8",
    "libgcc-s1", "liblzma5", "libncursesw6", "libpython3-stdlib", "libpython3.11-minimal",
    "libpython3.11-stdlib", "libreadline8", "libsqlite3-0", "libssl3", "libstdc++6", "libtinfo6", 
    "libuuid1", "media-types", "python3", "python3-minimal", "python3.11", "python3.11-minimal",
    "zlib1g",
)  # fmt: skip
EXTRAS = {  # by which Ray starts its processes, and its operator waits for the head
    "fleet": ("bash", "coreutils", "libacl1", "libattr1", "libgmp10", "libpcre2-8-0", "libselinux1"),
}
LEFT_OUT = ("/usr/share/doc/", "/usr/share/man/", "/usr/share/lintian/", "/usr/share/locale/", "/usr/share/info/")
USER = "gear-twin:x:10001:10001::/data:/usr/sbin/nologin\n"
GROUP = "gear-twin:x:10001:\n"


def main(root: Path, byte_code: Path, extra: str = "") -> None:
    files: list[str] = []
    for package in (*PACKAGES, *EXTRAS.get(extra, ())):
        listed = subprocess.run(["dpkg", "-L", package], check=True, capture_output=True, text=True).stdout
        files += [name for name in listed.splitlines() if not name.startswith(LEFT_OUT)]
    files += byte_code.read_text().splitlines()
    root.mkdir()
    for link in ("bin", "lib", "lib64", "sbin"):
        (root / link).symlink_to(f"usr/{link}")
    for folder in ("data", "tmp", "etc", "proc", "sys", "dev", "run", "usr/bin", "usr/lib", "usr/lib64", "usr/sbin"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    names = "\n".join(
        name.lstrip("/") for name in sorted(set(files)) if not Path(name).is_dir() or Path(name).is_symlink()
    )
    pack = subprocess.Popen(
        ["tar", "-C", "/", "--no-recursion", "--files-from", "-", "-c"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    unpack = subprocess.Popen(["tar", "-C", str(root), "--keep-directory-symlink", "-x"], stdin=pack.stdout)
    assert pack.stdin is not None
    pack.stdin.write(names.encode())
    pack.stdin.close()
    if pack.wait() or unpack.wait():
        raise SystemExit("the system's files could not be copied")
    for name in ("etc/ssl/certs/ca-certificates.crt", "var/lib/dpkg/status"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(Path("/", name).read_bytes())
    (root / "etc/passwd").write_text("root:x:0:0:root:/root:/usr/sbin/nologin\n" + USER)
    (root / "etc/group").write_text("root:x:0:\n" + GROUP)
    (root / "tmp").chmod(0o1777)
    subprocess.run(["chown", "10001:10001", str(root / "data")], check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])

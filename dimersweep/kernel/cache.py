"""Where compiled code is kept: in folders of our own, each named by the sources and the compiler that its code is made of.

Numba's own cache misses edits in imported modules, and its settings belong to the whole process. Here each compiled
function has a cache of its own (``jit.py``), and only what bears our mark is ever deleted.
"""

import hashlib
import os
import platform
import re
import time
import uuid
from functools import cache
from importlib.metadata import version
from pathlib import Path

KEPT_SECONDS = 30 * 86400.0  # folders of other versions go when unused for this long
MARK = "made-by-dimersweep"  # the file that tells a folder of ours, touched at each use
SUFFIX = ".code"
_KEY = re.compile("[0-9a-f]{16}")


def sources_digest(folder: Path) -> bytes:
    """Hash of the Python sources below `folder`, with their paths in it."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.digest()


@cache
def kernel_version(sources: Path = Path(__file__).parent) -> str:
    """Short hash of the kernel's `sources` and of what compiles them: 16 hexadecimal digits."""
    digest = hashlib.sha256(sources_digest(sources))
    for made_by in (version("numba"), version("numpy"), platform.python_version()):
        digest.update(made_by.encode() + b"\0")
    return digest.hexdigest()[:16]


def base_folder() -> Path:
    """The folder of all versions: below NUMBA_CACHE_DIR if that is set, else below the user's cache folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    return (Path(chosen) if chosen else Path.home() / ".cache").absolute() / "dimersweep"


def code_folder() -> Path:
    """The folder of this version; it may not exist."""
    return base_folder() / kernel_version()


def is_compiled() -> bool:
    """Whether compiled code of this version of the kernel is at hand, so that the next call is quick."""
    return any(code_folder().glob("*" + SUFFIX))


def load(name: str) -> bytes | None:
    """The code that was saved by that name, if there is any; its folder is marked as used now."""
    folder = code_folder()
    try:
        code = (folder / (name + SUFFIX)).read_bytes()
        os.utime(folder / MARK)
    except OSError:
        return None
    return code


def save(name: str, code: bytes) -> None:
    """Keep `code` by that name, and delete what has not been used for long; nothing happens where that is not allowed."""
    folder = code_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / MARK).touch()
        scratch = folder / f"{name}.{uuid.uuid4().hex}.tmp"
        scratch.write_bytes(code)
        scratch.replace(folder / (name + SUFFIX))
        prune(folder.parent, keep=folder.name)
    except OSError:
        pass


def prune(base: Path, keep: str) -> None:
    """Delete the folders of code below `base`, other than `keep`, that no process has used for 30 days.

    Only what bears our mark is one, and only files of ours are deleted in it: a folder that holds anything else stays.
    """
    for folder in base.iterdir():
        mark = folder / MARK
        ours = _KEY.fullmatch(folder.name) and not folder.is_symlink() and mark.is_file()
        if ours and folder.name != keep and time.time() - mark.stat().st_mtime > KEPT_SECONDS:
            _delete(folder)


def _delete(folder: Path) -> None:
    files = list(folder.iterdir())
    if all(path.is_file() and (path.name == MARK or path.suffix in (SUFFIX, ".tmp")) for path in files):
        for path in files:
            path.unlink(missing_ok=True)
        folder.rmdir()

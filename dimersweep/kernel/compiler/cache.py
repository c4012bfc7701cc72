"""Where compiled code is kept: in folders of our own, each named by the sources and the compiler that its code is made of.

Numba's own cache misses edits in imported modules, and its settings belong to the whole process. Here each compiled
function has a cache of its own (``keeping.py``), and only what bears our mark is ever deleted.
"""

import hashlib
import os
import re
import stat
import time
import uuid
import warnings
from contextlib import suppress
from pathlib import Path

from dimersweep.kernel.compiler.versions import PYTHON, code_version, way

KEPT_SECONDS = 30 * 86400.0  # folders of other versions go when unused for this long
MARK = "made-by-dimersweep"  # the file by which a folder of ours is known, touched at each use
SUFFIX = ".code"
DIGEST_BYTES = 32  # a checksum of name and code is written before the code: damaged code could end the process
_KEY = re.compile("[0-9a-f]{16}")


def base_folders() -> list[Path]:
    """The folders of all versions, in the order in which they are tried.

    Below NUMBA_CACHE_DIR if that is set, else below the user's cache folder; where that cannot be written, in the temporary
    folder, by the user's number, if nobody else can write there.
    """
    scratch = Path(os.environ.get("TMPDIR") or "/tmp") / f"dimersweep-{os.getuid()}"
    with suppress(RuntimeError):  # nobody knows of a home
        return [_chosen() / "dimersweep", scratch]
    return [scratch]


def _chosen() -> Path:
    chosen = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    return (Path(chosen) if chosen else Path.home() / ".cache").absolute()


def _is_trusted(base: Path) -> bool:
    """Whether what is found in one of the `base_folders` was put there by whom the user trusts: code is run from it."""
    if not base.name.startswith("dimersweep-"):
        return True
    try:
        found = base.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


def code_folders(version: str | None = None) -> list[Path]:
    """The folders of a version, by default of this one, in the order in which they are tried; they may not exist."""
    return [base / (version or code_version()) for base in base_folders()]


def is_compiled() -> bool:
    """Whether compiled code of this version of the kernel is at hand, or none is needed, so that the next call is quick."""
    return way() == PYTHON or any(
        _is_trusted(folder.parent) and any(folder.glob("*" + SUFFIX)) for folder in code_folders()
    )


def load(name: str, version: str | None = None) -> bytes | None:
    """The code that was saved by that name, if it is there and undamaged; its folder is marked as used now."""
    for folder in code_folders(version):
        with suppress(OSError):
            if _is_trusted(folder.parent):
                content = (folder / (name + SUFFIX)).read_bytes()
                code = content[DIGEST_BYTES:]
                if content[:DIGEST_BYTES] != _checksum(name, code):
                    continue  # it will be compiled and saved again
                with suppress(OSError):  # a folder that others have filled
                    os.utime(folder / MARK)
                return code
    return None


def _checksum(name: str, code: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + code).digest()


def save(name: str, code: bytes, version: str | None = None) -> None:
    """Keep `code` by that name, and delete what has not been used for long.

    Where no folder can be written, one line says so, and the next process compiles again.
    """
    for folder in code_folders(version):
        try:
            folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _is_trusted(folder.parent):
                continue
            folder.mkdir(exist_ok=True)
            (folder / MARK).touch()
            _write(folder / (name + SUFFIX), _checksum(name, code) + code)
        except OSError:
            continue
        with suppress(OSError):
            prune(folder.parent, keep=folder.name)
        return
    tried = " or ".join(str(base) for base in base_folders())
    warnings.warn(
        f"compiled code cannot be kept in {tried}, so every process compiles; NUMBA_CACHE_DIR names another folder",
        RuntimeWarning,
        stacklevel=2,
    )


def _write(path: Path, content: bytes) -> None:
    """Write a file at once, whoever else does the same."""
    scratch = path.with_name(f"{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        scratch.write_bytes(content)
        scratch.replace(path)
    except OSError:
        scratch.unlink(missing_ok=True)
        raise


def prune(base: Path, keep: str) -> None:
    """Delete the folders of code below `base`, other than `keep`, that no process has used for 30 days.

    Only what bears our mark is one, and only files of ours are deleted in it: a folder that holds anything else stays.
    """
    for folder in base.iterdir():
        mark = folder / MARK
        ours = _KEY.fullmatch(folder.name) and not folder.is_symlink() and mark.is_file()
        with suppress(OSError):  # another process may do the same
            if ours and folder.name != keep and time.time() - mark.stat().st_mtime > KEPT_SECONDS:
                _delete(folder)


def _delete(folder: Path) -> None:
    files = list(folder.iterdir())
    if all(path.is_file() and (path.name == MARK or path.suffix in (SUFFIX, ".tmp")) for path in files):
        for path in files:
            path.unlink(missing_ok=True)
        folder.rmdir()

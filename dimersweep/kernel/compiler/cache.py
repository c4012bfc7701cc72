"""Compiled code, kept in folders of our own, each named by the sources and the compiler that its code is made of.

Numba's own cache misses edits in imported modules, and its settings belong to the whole process. Only what bears our mark is
ever deleted. A Numba that has changed inside costs the cache, and nothing else: then every process compiles.
"""

import functools
import hashlib
import inspect
import os
import pickle
import re
import stat
import threading
import time
import uuid
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from dimersweep.kernel.compiler.versions import sources_digest, take_digests

KEPT_SECONDS = 30 * 86400.0  # folders of other versions go when unused for this long
MARK = "made-by-dimersweep"  # the file by which a folder of ours is known, touched at each use
SUFFIX = ".code"
DIGEST_BYTES = 32  # a checksum of name and code is written before the code: damaged code could end the process
_KEY = re.compile("[0-9a-f]{16}")
_folder_digest = functools.cache(sources_digest)
# whether a function that Python calls is being compiled, and whether one has been compiled or loaded
under_way, ready = threading.Event(), threading.Event()
take_digests()  # before the modules are imported that hold the functions


def base_folders() -> list[Path]:
    """The folders of all versions, in the order in which they are tried.

    Below NUMBA_CACHE_DIR if that is set, else below the user's cache folder; where that cannot be written, in the temporary
    folder, by the user's number, if nobody else can write there.
    """
    scratch = Path(os.environ.get("TMPDIR") or "/tmp") / f"dimersweep-{os.getuid()}"
    with suppress(RuntimeError):  # nobody knows of a home
        chosen = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return [Path(chosen).absolute() / "dimersweep", scratch]
    return [scratch]


def _is_trusted(base: Path) -> bool:
    """Whether what is found in one of the `base_folders` was put there by whom the user trusts: code is run from it."""
    if not base.name.startswith("dimersweep-"):
        return True
    try:
        found = base.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022


def code_folders(version: str) -> list[Path]:
    """The folders of a version that can be trusted, in the order in which they are tried; they may not exist."""
    return [base / version for base in base_folders() if _is_trusted(base)]


def holds(version: str) -> bool:
    """Whether there is code of this version."""
    return any(any(folder.glob("*" + SUFFIX)) for folder in code_folders(version))


def load(version: str, name: str) -> bytes | None:
    """The code that was saved by that name, if it is there and undamaged; its folder is marked as used now."""
    for folder in code_folders(version):
        with suppress(OSError):
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


def save(version: str, name: str, code: bytes) -> None:
    """Keep `code` by that name, and delete what has not been used for long.

    Where no folder can be written, one line says so, and the next process compiles again.
    """
    for base in base_folders():
        with suppress(OSError):
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_trusted(base):
                _write(base / version, name, code)
                prune(base, keep=version)
                return
    tried = " or ".join(str(base) for base in base_folders())
    warnings.warn(
        f"compiled code cannot be kept in {tried}, so every process compiles; NUMBA_CACHE_DIR names another folder",
        RuntimeWarning,
        stacklevel=2,
    )


def _write(folder: Path, name: str, code: bytes) -> None:
    """Keep code in a folder at once, whoever else does the same."""
    folder.mkdir(exist_ok=True)
    (folder / MARK).touch()
    scratch = folder / f"{name}.{uuid.uuid4().hex}.tmp"
    try:
        scratch.write_bytes(_checksum(name, code) + code)
        scratch.replace(folder / (name + SUFFIX))
    finally:
        scratch.unlink(missing_ok=True)


def prune(base: Path, keep: str) -> None:
    """Delete the folders of code below `base`, other than `keep`, that no process has used for 30 days.

    Only what bears our mark is one, and only files of ours are deleted in it: a folder that holds anything else stays.
    """
    for folder in base.iterdir():
        mark = folder / MARK
        if folder.name == keep or not _KEY.fullmatch(folder.name) or folder.is_symlink() or not mark.is_file():
            continue
        with suppress(OSError):  # another process may do the same
            files = list(folder.iterdir())
            ours = all(path.is_file() and (path == mark or path.suffix in (SUFFIX, ".tmp")) for path in files)
            if ours and time.time() - mark.stat().st_mtime > KEPT_SECONDS:
                for path in files:
                    path.unlink(missing_ok=True)
                folder.rmdir()


class _Kept:
    """The cache of one compiled function; methods and arguments are those that Numba asks a cache for."""

    cache_path = None

    def __init__(self, function: Callable[..., Any], folder: Path, version: str) -> None:
        self._digest = hashlib.sha256(
            _folder_digest(folder) + f"{function.__module__}.{function.__qualname__}".encode()
        )
        self._function, self._version = function.__name__, version

    def _name(self, signature: Any) -> str:
        digest = self._digest.copy()
        digest.update(f" {signature}".encode())
        return f"{self._function}-{digest.hexdigest()[:16]}"

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compiled function for arguments of some types, or None."""
        code = load(self._version, self._name(signature))
        with suppress(Exception):  # whatever it is, compiling mends it
            if code is not None:
                from numba.core.compiler import CompileResult

                context.refresh()  # what the code refers to must be known
                found = CompileResult._rebuild(context, *pickle.loads(code))
                ready.set()
                return found
        under_way.set()
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep it; the addresses of this process in it are those of functions that are handed on, and are never read."""
        under_way.clear()
        ready.set()
        try:
            from numba.core.serialize import dumps

            code = dumps(result._reduce())
        except Exception as error:  # of a Numba that is not known yet
            warnings.warn(f"compiled code cannot be kept ({error})", RuntimeWarning, stacklevel=2)
        else:
            save(self._version, self._name(signature), code)

    def flush(self) -> None:
        """Nothing waits to be written."""

    enable = disable = flush


def kept(function: Any, version: str) -> Any:
    """Keep the code of a compiled function for later processes: by a version and all sources of the function's folder."""
    path = Path(inspect.getfile(function.py_func))
    if path.is_file() and not function.py_func.__closure__:  # no prompt, and nothing that sources do not tell
        function._cache = _Kept(function.py_func, path.parent, version)
    return function

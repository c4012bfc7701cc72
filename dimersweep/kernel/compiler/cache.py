"""Compiled code, kept in files that are named by the sources and the compiler that it is made of.

Numba's own cache misses edits in imported modules, and its settings belong to the whole process. Only files of ours are
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

KEPT_SECONDS = 30 * 86400.0  # code that is unused for this long goes
SUFFIX = ".code"
DIGEST_BYTES = 32  # a checksum of name and code is written before the code: damaged code could end the process
_OURS = re.compile(r"[0-9a-f]{16}-.+\.(code|tmp)")  # names of files of ours
_folder_digest = functools.cache(sources_digest)
# whether a function that Python calls is being compiled, and whether one has been compiled or loaded
under_way, ready = threading.Event(), threading.Event()
take_digests()  # before the modules are imported that hold the functions


def base_folders() -> list[Path]:
    """The folders in which code is kept, in the order in which they are tried.

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
    with suppress(OSError):
        found = base.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return False


def files(version: str, name: str = "*") -> list[Path]:
    """The files with code of this version, by one name or all, that can be trusted; the first one counts."""
    return [file for base in base_folders() if _is_trusted(base) for file in base.glob(f"{version}-{name}{SUFFIX}")]


def load(version: str, name: str) -> bytes | None:
    """The code that was saved by that name, if it is there and undamaged; it is marked as used now."""
    for file in files(version, name):
        with suppress(OSError):
            content = file.read_bytes()
            code = content[DIGEST_BYTES:]
            if content[:DIGEST_BYTES] != _checksum(file, code):
                continue  # it will be compiled and saved again
            with suppress(OSError):  # a file of others
                os.utime(file)
            return code
    return None


def _checksum(file: Path, code: bytes) -> bytes:
    return hashlib.sha256(file.name.encode() + b"\0" + code).digest()


def save(version: str, name: str, code: bytes) -> None:
    """Keep `code` by that name, at once, whoever else does the same, and delete what has not been used for long.

    Where no folder can be written, one line says so, and the next process compiles again.
    """
    for base in base_folders():
        with suppress(OSError):
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_trusted(base):
                file = base / f"{version}-{name}{SUFFIX}"
                scratch = file.with_suffix(f".{uuid.uuid4().hex}.tmp")
                try:
                    scratch.write_bytes(_checksum(file, code) + code)
                    scratch.replace(file)
                finally:
                    scratch.unlink(missing_ok=True)
                prune(base)
                return
    tried = " or ".join(str(base) for base in base_folders())
    warn(f"compiled code cannot be kept in {tried}, so every process compiles; NUMBA_CACHE_DIR names another folder")


def warn(text: str) -> None:
    """Say what goes on, but not as it should."""
    warnings.warn(text, RuntimeWarning, stacklevel=3)


def prune(base: Path) -> None:
    """Delete the files of ours in a folder that no process has used for 30 days."""
    for file in base.iterdir():
        with suppress(OSError):  # another process may do the same
            if _OURS.fullmatch(file.name) and time.time() - file.lstat().st_mtime > KEPT_SECONDS:
                file.unlink()  # which neither follows a link nor deletes a folder


class _Kept:
    """The cache of one compiled function; methods and arguments are those that Numba asks a cache for."""

    cache_path = None

    def __init__(self, function: Callable[..., Any], folder: Path, version: str) -> None:
        self._sources, self._function, self._version = _folder_digest(folder), function, version

    def _name(self, signature: Any) -> str:
        told = f"{self._function.__module__}.{self._function.__qualname__} {signature}"
        return f"{self._function.__name__}-{hashlib.sha256(self._sources + told.encode()).hexdigest()[:16]}"

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
            warn(f"compiled code cannot be kept ({error})")
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

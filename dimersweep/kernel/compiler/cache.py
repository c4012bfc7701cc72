"""Cache of compiled code, in files that are named by the sources and the compiler of the code.

Numba's own cache misses edits in imported modules, and its settings belong to the whole process. Only files of this
cache are ever deleted. If a new Numba has changed inside, only the cache fails: then every process compiles.
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

from dimersweep.kernel.compiler.versions import digest_of, sources, take_sources

KEPT_SECONDS = 30 * 86400.0  # age at which a file that no process has used is deleted [s]
SUFFIX = ".code"
DIGEST_BYTES = 32  # bytes of the checksum of name and code in front of the code: damaged code could end the process
_OURS = re.compile(r"[0-9a-f]{16}-.+\.(code|tmp)")  # names of the files of this cache
# set while a function that Python calls is compiled; set once such a function has been compiled or loaded
under_way, ready = threading.Event(), threading.Event()
# the sources are taken before the modules with the kernel's functions are imported: they may be edited after that
take_sources()


@functools.cache
def _folder_digest(folder: Path) -> bytes:
    """Return a hash of the sources below a folder."""
    return digest_of(sources(folder))


def base_folders() -> list[Path]:
    """Return the folders for compiled code, in the order in which they are tried.

    The first is below NUMBA_CACHE_DIR if that is set, else below the user's cache folder. The last is in the temporary
    folder, and named by the user's number. It serves where the first cannot be written, if nobody else can write in it.
    """
    scratch = Path(os.environ.get("TMPDIR") or "/tmp") / f"dimersweep-{os.getuid()}"
    with suppress(RuntimeError):  # the user has no home folder
        chosen = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return [Path(chosen).absolute() / "dimersweep", scratch]
    return [scratch]


def _is_trusted(base: Path) -> bool:
    """Return True if only the user, or whoever the user trusts, can have written in one of the `base_folders`.

    Code from these folders is run.
    """
    if not base.name.startswith("dimersweep-"):
        return True
    with suppress(OSError):
        found = base.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return False


def files(version: str, name: str = "*") -> list[Path]:
    """Return the files with the code of a version in the trusted folders: of one `name`, by default of any name.

    They are in the order of `base_folders`. Of several files with one name, the first that is intact is loaded.
    """
    return [file for base in base_folders() if _is_trusted(base) for file in base.glob(f"{version}-{name}{SUFFIX}")]


def load(version: str, name: str) -> bytes | None:
    """Return the code that was saved by a name, and mark its file as used now; None if it is absent or damaged."""
    for file in files(version, name):
        with suppress(OSError):
            content = file.read_bytes()
            code = content[DIGEST_BYTES:]
            if content[:DIGEST_BYTES] != _checksum(file, code):
                continue  # damaged code is compiled and saved again
            with suppress(OSError):  # a file of another user may be read, but not marked
                os.utime(file)
            return code
    return None


def _checksum(file: Path, code: bytes) -> bytes:
    return hashlib.sha256(file.name.encode() + b"\0" + code).digest()


def save(version: str, name: str, code: bytes) -> None:
    """Save `code` by a name in the first folder that can be written, and delete old files there, see `prune`.

    The file appears whole, even if several processes write it. If no folder can be written, a warning says so, and the
    next process compiles again.
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
    """Warn the user of something that works, but not as it should."""
    warnings.warn(text, RuntimeWarning, stacklevel=3)


def prune(base: Path) -> None:
    """Delete the files of this cache in a folder that no process has used for 30 days."""
    for file in base.iterdir():
        with suppress(OSError):  # another process may do the same
            if _OURS.fullmatch(file.name) and time.time() - file.lstat().st_mtime > KEPT_SECONDS:
                file.unlink()  # deletes a link itself, not its target, and no folder


class _Kept:
    """The cache of one compiled function, with the methods that Numba calls of a cache."""

    cache_path = None

    def __init__(self, function: Callable[..., Any], folder: Path, version: str) -> None:
        self._sources, self._function, self._version = _folder_digest(folder), function, version

    def _name(self, signature: Any) -> str:
        text = f"{self._function.__module__}.{self._function.__qualname__} {signature}"
        return f"{self._function.__name__}-{hashlib.sha256(self._sources + text.encode()).hexdigest()[:16]}"

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the compiled function for a signature from the cache, or None if it must be compiled."""
        code = load(self._version, self._name(signature))
        with suppress(Exception):  # of any kind: compiling anew mends it
            if code is not None:
                from numba.core.compiler import CompileResult
                from numba.core.runtime import rtsys

                # for functions that allocate, which the kernel itself does not have. The rest of `context.refresh()` is
                # for compiling, and takes as long as all else: other functions that code refers to are there already
                rtsys.initialize(context)
                found = CompileResult._rebuild(context, *pickle.loads(code))
                ready.set()
                return found
        under_way.set()
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Save the compiled function for a signature.

        The code holds addresses of this process, of functions that are passed as arguments; nothing ever reads them.
        """
        under_way.clear()
        ready.set()
        try:
            from numba.core.serialize import dumps

            code = dumps(result._reduce())
        except Exception as error:  # of any kind, from a Numba that has changed inside
            warn(f"compiled code cannot be kept ({error})")
        else:
            save(self._version, self._name(signature), code)

    def flush(self) -> None:
        """Do nothing, since each function is written at once."""

    enable = disable = flush


def kept(function: Any, version: str) -> Any:
    """Give a compiled function a cache for later processes, and return it.

    Its code is saved by a version and by all sources in the folder of the function.
    """
    path = Path(inspect.getfile(function.py_func))
    # a function from a prompt has no sources, and values in a closure do not stand in them
    if path.is_file() and not function.py_func.__closure__:
        function._cache = _Kept(function.py_func, path.parent, version)
    return function

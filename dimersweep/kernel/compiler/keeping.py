"""The code of compiled functions, kept on disk in the place of Numba's own cache.

A Numba that has changed inside costs the cache, and nothing else: then every process compiles.
"""

import hashlib
import inspect
import pickle
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba

from dimersweep.kernel.compiler.cache import load, save
from dimersweep.kernel.compiler.versions import sources_digest, take_digests

take_digests()  # before the modules are imported that hold the functions
_config: Any = numba.config
_folder_digest = cache(sources_digest)
# whether a function that Python calls is being compiled, and whether one has been compiled or loaded
under_way, ready = threading.Event(), threading.Event()


class _Kept:
    """The cache of one compiled function; methods and arguments are those that Numba asks a cache for."""

    cache_path = None

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._digest = hashlib.sha256(
            _folder_digest(folder) + f"{function.__module__}.{function.__qualname__}".encode()
        )
        self._function = function.__name__

    def _name(self, signature: Any) -> str:
        digest = self._digest.copy()
        digest.update(f" {signature}".encode())
        return f"{self._function}-{digest.hexdigest()[:16]}"

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compiled function for arguments of some types, or None."""
        code = load(self._name(signature))
        with suppress(Exception):  # whatever it is, compiling mends it
            if code is not None:
                from numba.core.compiler import CompileResult

                context.refresh()  # what the code refers to must be known
                result: Any = CompileResult
                found = result._rebuild(context, *pickle.loads(code))
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
            warnings.warn(
                f"numba {numba.__version__}: compiled code cannot be kept ({error})", RuntimeWarning, stacklevel=2
            )
        else:
            save(self._name(signature), code)

    def flush(self) -> None:
        """Nothing waits to be written."""

    enable = disable = flush


def kept(function: Any) -> Any:
    """Keep the code of a compiled function for later processes: by the kernel's version and all sources of its own folder."""
    if not _config.DISABLE_JIT:
        path = Path(inspect.getfile(function.py_func))
        if path.is_file() and not function.py_func.__closure__:  # no prompt, and nothing that sources do not tell
            function._cache = _Kept(function.py_func, path.parent)
    return function

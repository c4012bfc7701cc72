"""Where compiled code is kept: a folder named by the kernel's sources, since Numba misses edits in imported modules."""

import hashlib
import os
import platform
import shutil
import sys
import time
from functools import cache
from importlib.metadata import version
from pathlib import Path

KEPT_SECONDS = 30 * 86400.0  # folders of other versions go when unused for this long


@cache
def kernel_version(sources: Path = Path(__file__).parent) -> str:
    """Short hash of the kernel's `sources` and of what compiles them: 16 hexadecimal digits."""
    digest = hashlib.sha256()
    for made_by in (version("numba"), version("numpy"), platform.python_version()):
        digest.update(made_by.encode() + b"\0")
    for path in sorted(sources.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def base_folder() -> Path:
    """The folder of all versions: below NUMBA_CACHE_DIR if that is set, else below the user's cache folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dimersweep"
    folder = Path(chosen)
    if folder.parent.name == "dimersweep":  # set by a parent process through `use_cache_folder`
        return folder.parent
    return folder / "dimersweep"


def prune(base: Path, keep: str) -> None:
    """Delete the folders below `base`, other than `keep`, that no process has used for 30 days."""
    for folder in base.iterdir():
        if folder.is_dir() and folder.name != keep and time.time() - folder.stat().st_mtime > KEPT_SECONDS:
            shutil.rmtree(folder, ignore_errors=True)


def use_cache_folder() -> Path:
    """Point Numba to this kernel's folder, marked as used now, and return it.

    Must run before a kernel module is imported: Numba reads the setting when it decorates a function. The environment
    variable serves a Numba that is not imported yet (so reading the kernel's names stays quick) and child processes.
    """
    base = base_folder()
    folder = base / kernel_version()
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        prune(base, keep=folder.name)
    except OSError:  # a read-only home: Numba then looks for another place by itself
        pass
    return folder


def is_compiled() -> bool:
    """Whether compiled code of this version of the kernel is at hand, so that the next call is quick."""
    return any(Path(os.environ["NUMBA_CACHE_DIR"]).rglob("*.nbi"))

"""One sweep at a time in a folder: a lock that the system drops with its holder, however that ends."""

import errno
import fcntl
import json
import os
import socket
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dimersweep.errors import StoreError

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK)  # of network disks that are mounted without them
LOCK_SECONDS = 0.3  # seconds: `holder` looks at a lock by taking it for a moment


def _try(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        message = "this file system has no locks; take care that no other sweep writes to the same output"
        warnings.warn(message, RuntimeWarning, stacklevel=2)
    return True


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _holder(path: Path) -> str:
    try:
        holder = json.loads(path.read_text(encoding="utf-8"))
        return f"process {holder['pid']} on {holder['host']}, since {holder['since']}"
    except (OSError, ValueError, KeyError, TypeError):  # it has not written its name yet
        return "another process"


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, in a folder that is made if it is missing: its former holder may just have deleted it.

    Raises
    ------
    StoreError
        If another process holds it, naming that process, or there is no folder but something else of that name: a link
        might lead to a folder of the user's.
    OSError
        If the file cannot be made.
    """
    folder = path.parent
    if os.path.lexists(folder) and (folder.is_symlink() or not folder.is_dir()):
        raise StoreError(f"{folder}: is no folder, where what is finished is kept; move it, or give another output")
    patience_ends = time.monotonic() + LOCK_SECONDS
    while True:
        folder.mkdir(exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        try:
            held = _try(handle)
            # a file that its holder has deleted meanwhile is not the one that others will find
            if held and _is_at(handle, path):
                break
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
        if not held and time.monotonic() > patience_ends:
            raise StoreError(f"{folder}: a sweep is at work here ({_holder(path)}); wait for it or stop it first")
        time.sleep(0.02)
    try:
        me = {"pid": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
        os.ftruncate(handle, 0)
        os.write(handle, json.dumps(me).encode())
        yield
    finally:
        os.close(handle)


def holder(path: Path) -> str:
    """Who holds the lock file `path`, or "" if nobody does."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return ""
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _holder(path)
    except OSError:
        return ""
    finally:
        os.close(handle)
    return ""

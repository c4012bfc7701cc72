"""Lock a store for one process at a time.

The lock lies on a byte of the file of the store. The system releases it when its process ends, however that happens.
"""

import errno
import fcntl
import os
import struct
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK)  # errors of network disks that are mounted without locks
BYTE = 0x40000200  # the first byte behind those that SQLite locks (0x40000000 and the 511 after it)
# A lock of an open file, not of a process: SQLite opens and closes the file, which drops all locks of a process on it.
if sys.platform == "darwin":  # Python has no names for these numbers there
    GET_LOCK, SET_LOCK, FLOCK, KIND = 92, 90, struct.Struct("qqihh"), 3
    WANTED = (BYTE, 1, 0, fcntl.F_WRLCK, os.SEEK_SET)
else:
    GET_LOCK, SET_LOCK, FLOCK, KIND = fcntl.F_OFD_GETLK, fcntl.F_OFD_SETLK, struct.Struct("hhqqi4x"), 0
    WANTED = (fcntl.F_WRLCK, os.SEEK_SET, BYTE, 1, 0)

# Device and inode of the files that this process has locked: opening and closing one again could drop SQLite's locks.
_locked_files: set[tuple[int, int] | None] = set()
_guard = threading.Lock()


def _on_byte(handle: int, what: int) -> int:
    """Look up the lock on the byte (`what` is GET_LOCK), or take it (SET_LOCK); return the kind of the lock found."""
    return int(FLOCK.unpack(fcntl.fcntl(handle, what, FLOCK.pack(*WANTED)))[KIND])


def _number(file: Path | int) -> tuple[int, int] | None:
    """Return device and inode of a file; None if there is no file."""
    with suppress(FileNotFoundError):
        found = os.stat(file)
        return found.st_dev, found.st_ino
    return None


def is_locked(path: Path) -> bool:
    """Return True if a process is at work at the store `path`."""
    with _guard, suppress(OSError):
        if _number(path) in _locked_files:
            return True
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            return _on_byte(handle, GET_LOCK) != fcntl.F_UNLCK
        finally:
            os.close(handle)
    return False


def _take(path: Path) -> tuple[int, bool]:
    """Open a file and lock it; return its handle, and False if the file system has no locks."""
    honest = True
    with _guard:
        if _number(path) in _locked_files:
            raise BlockingIOError
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        try:
            _on_byte(handle, SET_LOCK)
        except OSError as error:
            if error.errno not in NO_LOCKS:
                os.close(handle)
                raise
            honest = False
        _locked_files.add(_number(handle))
    return handle, honest


def _let_go(handle: int) -> None:
    """Release the lock of an open file, and close it."""
    with _guard:
        _locked_files.discard(_number(handle))
        os.close(handle)


@contextmanager
def locked(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Hold the lock of a store; yield the first bytes of its file, and True if the file system has locks.

    Parameters
    ----------
    path : Path
        File of the store, which is made if it is missing. A link is refused, as it might lead to a file of the user's.

    Raises
    ------
    BlockingIOError
        If another process, or another thread of this one, has the lock.
    OSError
        If the file cannot be made.
    """
    handle, honest = _take(path)
    while _number(path) != _number(handle):  # a former holder has just deleted it
        _let_go(handle)
        handle, honest = _take(path)
    try:
        yield os.pread(handle, 100, 0), honest
    finally:
        _let_go(handle)

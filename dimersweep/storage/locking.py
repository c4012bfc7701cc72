"""One process at a time at a store: a lock on a byte of its file, which the system drops with its holder, however that ends."""

import errno
import fcntl
import os
import struct
import sys
import threading
import warnings
from contextlib import suppress
from pathlib import Path

NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK)  # of network disks that are mounted without them
BYTE = 0x40000200  # the first one behind those that SQLite locks
# A lock of an open file, not of a process: SQLite opens and closes the same file, which drops all locks of a process on it.
if sys.platform == "darwin":
    ASK, TAKE, FLOCK = 92, 90, struct.Struct("qqihh")  # Python does not name them
else:
    ASK, TAKE, FLOCK = fcntl.F_OFD_GETLK, fcntl.F_OFD_SETLK, struct.Struct("hhqqi4x")

_held: set[tuple[int, int]] = set()  # device and number of the files that this process has locked
_guard = threading.Lock()


def _on_byte(handle: int, what: int, kind: int) -> int:
    """Ask for a lock of a `kind` on the byte, or take it; the kind that is in its way."""
    linux = sys.platform != "darwin"
    asked = FLOCK.pack(*((kind, os.SEEK_SET, BYTE, 1, 0) if linux else (BYTE, 1, 0, kind, os.SEEK_SET)))
    return int(FLOCK.unpack(fcntl.fcntl(handle, what, asked))[0 if linux else 3])


def _name(handle: int) -> tuple[int, int]:
    found = os.fstat(handle)
    return found.st_dev, found.st_ino


def is_locked(path: Path) -> bool:
    """Whether a process is at work at the store `path`."""
    with _guard, suppress(OSError):
        found = os.stat(path)
        # this process must not even close a file that SQLite has locked for it
        if (found.st_dev, found.st_ino) in _held:
            return True
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            return _on_byte(handle, ASK, fcntl.F_WRLCK) != fcntl.F_UNLCK
        finally:
            os.close(handle)
    return False


class Lock:
    """The lock of a store, once it is held.

    Parameters
    ----------
    path : Path
        A file that is made if it is missing. A link is refused: it might lead to a file of the user's.

    Raises
    ------
    BlockingIOError
        If another process, or another thread of this one, holds it.
    OSError
        If the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.honest = True
        with _guard:
            if os.path.exists(path) and (os.stat(path).st_dev, os.stat(path).st_ino) in _held:
                raise BlockingIOError
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
            try:
                self._take()
            except BaseException:
                os.close(self._handle)
                raise
            _held.add(_name(self._handle))

    def _take(self) -> None:
        try:
            _on_byte(self._handle, TAKE, fcntl.F_WRLCK)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                raise BlockingIOError from None
            if error.errno not in NO_LOCKS:
                raise
            self.honest = False
            message = "this file system has no locks; take care that no other sweep writes to the same output"
            warnings.warn(message, RuntimeWarning, stacklevel=2)

    def is_at(self, path: Path) -> bool:
        """Whether the file that is locked is the one that others will find."""
        try:
            return os.path.samestat(os.fstat(self._handle), path.stat())
        except FileNotFoundError:
            return False

    def become(self, other: "Lock") -> None:
        """Hold another lock in place of this one: its file has taken the name of this one."""
        self.close()
        self._handle = other._handle

    def head(self) -> bytes:
        """The first bytes of the file: to open it once more could cost SQLite its locks."""
        return os.pread(self._handle, 100, 0)

    def empty(self) -> None:
        """Leave nothing in the file."""
        os.ftruncate(self._handle, 0)

    def close(self) -> None:
        """Let it go."""
        with _guard:
            _held.discard(_name(self._handle))
            os.close(self._handle)


def lock_of(path: Path) -> Lock:
    """The lock of the file that is at `path`: a former holder may just have deleted another one; raises as `Lock`."""
    lock = Lock(path)
    while not lock.is_at(path):
        lock.close()
        lock = Lock(path)
    return lock

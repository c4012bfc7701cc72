"""Writing files so that they are whole or absent, whenever the process is killed, and saying why one could not be written."""

import errno
import os
import re
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from dimersweep.errors import StoreError

# of a file that is being written, or that a kill has left half written
HALF = re.compile(r"\.dimersweep-[0-9a-f]{32}\.tmp")


def sync(path: Path) -> None:
    """Have the system put a file, or the names in a folder, on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno != errno.EINVAL or not path.is_dir():  # some network disks refuse it for folders
            raise
    finally:
        os.close(handle)


@contextmanager
def replacing(path: Path, scratch: Path | None = None) -> Iterator[Path]:
    """Where to write a file, or a folder, that then, whole and on the disk, takes the name `path`; goes if it is not written.

    Parameters
    ----------
    path : Path
        A file that is there stays as it is until then, and a folder is moved away whole: a kill leaves no half of it under its
        name.
    scratch : Path, optional
        The temporary name, in a folder that is the program's own and locked, where the next process finds what a kill has
        left; by default one that nobody else has, beside `path`. A file of that name that a kill has left stays: another
        process, on this machine or another, might be at work on it. The files of a folder are on the disk already.
    """
    # not of `tempfile`: its files can be read by their owner only, and keep that under their final names
    temporary = scratch or path.with_name(f".dimersweep-{uuid4().hex}.tmp")
    former = temporary.with_suffix(".old")
    try:
        delete(temporary)
        yield temporary
        if temporary.is_dir():
            delete(former)
            if path.exists():
                path.replace(former)
        else:
            sync(temporary)
        temporary.replace(path)
        sync(path.parent)  # the new name must outlive a power cut too
        delete(former)
    finally:
        delete(temporary)


def delete(path: Path) -> None:
    """Delete a file or a link, or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def disk_errors(what: str, then: str) -> Iterator[None]:
    """Turn an error of the disk into one line that names `what` could not be written, and says what `then` holds.

    Raises
    ------
    StoreError
    """
    try:
        yield
    except StoreError:
        raise
    except (OSError, RuntimeError, sqlite3.Error) as error:  # netCDF-C reports a full disk as a RuntimeError
        reason = getattr(error, "strerror", None) or error
        raise StoreError(f"{what}: could not be written ({reason})" + (f"; {then}" if then else "")) from error

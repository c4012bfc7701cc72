"""Write files so that they are whole or absent, whenever the process is killed, and report errors of the disk."""

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

# name of a file that is being written, or that a kill has left half written
HALF = re.compile(r"\.dimersweep-[0-9a-f]{32}\.tmp")


def sync(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk."""
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
    """Yield a temporary path to write a file or a folder to, which then takes the name `path` in one step.

    The file is whole and on the disk before it takes the name. It is deleted if the context ends with an error.

    Parameters
    ----------
    path : Path
        Final name. A file of this name stays as it is until the end. A folder is moved away whole, so that a kill
        leaves no half of it under its name.
    scratch : Path, optional
        Temporary path, known to the next process under the same lock, which deletes what a kill has left there. By
        default a new name beside `path`. A file that a kill leaves under such a name stays, as another process might be
        at work on it. The caller must have flushed the files of a folder to the disk.
    """
    # not by `tempfile`, whose files only their owner may read, also under their final names
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
    """Delete a file or a link, or a folder with all its files, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def disk_errors(what: str, then: str) -> Iterator[None]:
    """Turn errors of the disk into one line: `what` could not be written, and `then` as advice.

    Raises
    ------
    StoreError
        For any error of the disk, SQLite or netCDF-C.
    """
    try:
        yield
    except StoreError:
        raise
    except (OSError, RuntimeError, sqlite3.Error) as error:  # netCDF-C reports a full disk as a RuntimeError
        reason = getattr(error, "strerror", None) or error
        raise StoreError(f"{what}: could not be written ({reason})" + (f"; {then}" if then else "")) from error

"""Finished parts of a long calculation, kept in a folder beside its file until the file is whole."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.errors import StoreError
from dimersweep.storage.cubefiles import write_cube
from dimersweep.storage.files import HALF, disk_errors, put
from dimersweep.storage.formats.netcdf import read_netcdf
from dimersweep.storage.locking import locked
from dimersweep.storage.provenance import configured, differences, read_configuration

LOCK_FILE, CONFIGURATION = "lock", "configuration.json"
PART_SCRATCH = "scratch.tmp"  # a part as it is written: only who holds the lock does that
FILES = "part-*.nc"  # nothing else in the folder is ever read or removed


def parts_of(out: Path) -> Path:
    """The folder that holds the finished parts of the file `out`."""
    return out.with_name(f"{out.name}.parts")


class Parts:
    """What is finished of a file, a part for each name; see `parts_beside`.

    Parameters
    ----------
    out : Path, optional
        The file to be; without one nothing is kept.
    configuration : mapping
        All that decides the numbers, as JSON can hold it.
    """

    def __init__(self, out: Path | None, configuration: Mapping[str, Any]) -> None:
        self.folder = None if out is None else parts_of(out)
        self.configured = configured(configuration)

    def path(self, name: str) -> Path | None:
        """Where a part is kept."""
        return None if self.folder is None else self.folder / FILES.replace("*", name)

    def has(self, name: str) -> bool:
        """Whether a part is there."""
        path = self.path(name)
        return path is not None and path.is_file()

    def take(self, name: str, make: Callable[[], xr.Dataset]) -> xr.Dataset:
        """A part: read if it is there and sound, or made and kept."""
        path = self.path(name)
        if path is None:
            return make()
        part = self._kept(path)
        if part is None:
            write_cube(make().assign_attrs(self.configured), path, force=True, scratch=path.with_name(PART_SCRATCH))
            part = read_netcdf(path)  # a part that was kept and one that is new come the same way
        part.attrs = {key: value for key, value in part.attrs.items() if key not in self.configured}
        return part

    def _kept(self, path: Path) -> xr.Dataset | None:
        """A part, if it is there, undamaged and of this configuration; a warning names one that is not sound."""
        if not path.is_file():
            return None
        try:
            part = read_netcdf(path)
            if self.configured.items() <= part.attrs.items():
                return part
            why = f"{path}: is of another configuration"
        except StoreError as error:
            why = str(error)
        warnings.warn(f"{why}; it is made again", RuntimeWarning, stacklevel=5)  # of what has called make_borders
        return None

    def remove(self) -> None:
        """Remove the folder and what was written to it; whatever else is there stays, and the folder with it."""
        if self.folder is None or not self.folder.is_dir():
            return
        half = (path for path in self.folder.iterdir() if HALF.fullmatch(path.name))
        for path in (
            *half,
            *self.folder.glob(FILES),
            *(self.folder / name for name in (CONFIGURATION, PART_SCRATCH, LOCK_FILE)),
        ):
            path.unlink(missing_ok=True)
        with suppress(OSError):
            self.folder.rmdir()


@contextmanager
def parts_beside(out: Path | None, configuration: Mapping[str, Any], *, force: bool = False) -> Iterator[Parts]:
    """The parts of a file, in the folder ``<out>.parts``, under its lock.

    Parameters
    ----------
    out : Path, optional
    configuration : mapping
    force : bool
        Whether parts of another configuration may be removed.

    Raises
    ------
    StoreError
        If parts of another configuration are there, or another process is at work on them.
    """
    parts = Parts(out, configuration)
    if parts.folder is None:
        yield parts
        return
    with ExitStack() as stack:
        with disk_errors(str(parts.folder), ""):
            stack.enter_context(locked(parts.folder / LOCK_FILE))
            _claim(parts, configuration, force=force)
        try:
            yield parts
        except BaseException:
            if not any(parts.folder.glob(FILES)):
                parts.remove()
            raise


def _claim(parts: Parts, configuration: Mapping[str, Any], *, force: bool) -> None:
    """Enter the configuration of the parts, if none or the same is there."""
    assert parts.folder is not None
    head, text = parts.folder / CONFIGURATION, parts.configured["configuration"]
    if not head.is_file() and any(parts.folder.glob(FILES)):
        raise StoreError(
            f"{parts.folder}: holds {FILES} without a {CONFIGURATION}, which tells what they are; remove or rename the folder"
        )
    former = head.read_text(encoding="utf-8") if head.is_file() else text
    if former != text and not force:
        raise StoreError(_other(parts.folder, former, configuration))
    for path in parts.folder.glob(FILES) if former != text else ():
        path.unlink()
    put(head, [text.encode()])


def _other(folder: Path, former: str, configuration: Mapping[str, Any]) -> str:
    """What to say of parts that another configuration has left."""
    try:
        changed = differences(read_configuration(former), configuration)
    except ValueError:
        changed = ["the configuration there cannot be read"]
    lines = "".join(f"\n  {line}" for line in changed)
    return f"{folder}: holds parts of another file; remove it, or force it to be replaced (force=True). What differs:{lines}"

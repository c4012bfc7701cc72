"""Finished parts of a long calculation, kept in a folder beside its file until the file is whole."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.errors import StoreError
from dimersweep.storage.beside import Beside
from dimersweep.storage.cubefiles import write_cube
from dimersweep.storage.formats.netcdf import read_netcdf
from dimersweep.storage.provenance import configured


def parts_of(out: Path) -> Beside:
    """The folder that holds the finished parts of the file `out`."""
    return Beside(out, ".parts", r"part-.*\.nc")


def _part(beside: Beside, name: str) -> Path:
    return beside.path / f"part-{name}.nc"


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
        self.beside = None if out is None else parts_of(out)
        self.configured = configured(configuration)

    def has(self, name: str) -> bool:
        """Whether a part is there."""
        return self.beside is not None and _part(self.beside, name).is_file()

    def take(self, name: str, make: Callable[[], xr.Dataset]) -> xr.Dataset:
        """A part: read if it is there and sound, or made and kept."""
        if self.beside is None:
            return make()
        path = _part(self.beside, name)
        part = self._kept(path)
        if part is None:
            write_cube(make().assign_attrs(self.configured), path, force=True, scratch=self.beside.scratch)
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


@contextmanager
def parts_beside(out: Path | None, configuration: Mapping[str, Any], *, force: bool = False) -> Iterator[Parts]:
    """The parts of a file, in the folder ``<out>.parts``, under its lock; the folder goes if there are none.

    Parameters
    ----------
    out : Path, optional
    configuration : mapping
    force : bool
        See `Beside.claimed`, which also says what is raised.
    """
    parts = Parts(out, configuration)
    if parts.beside is None:
        yield parts
        return
    with parts.beside.claimed(configuration, 1, force=force):  # parts are not listed: each has its configuration in it
        try:
            yield parts
        except BaseException:
            if not parts.beside.files():
                parts.beside.remove()
            raise

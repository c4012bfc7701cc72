"""Finished parts of a long calculation, kept in a store beside its file until the file is whole."""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.cubes.results import Tile
from dimersweep.storage.files import delete, disk_errors
from dimersweep.storage.formats.netcdf import read_netcdf, write_netcdf
from dimersweep.storage.store import Store, finished_at, opened_store


def parts_of(out: Path) -> Path:
    """The store of the finished parts of the file `out`."""
    return out.with_name(out.name + ".parts")


def parts_there(out: Path, configuration: Mapping[str, Any]) -> list[str]:
    """Names of the parts of the file `out` that are finished, if they are of this configuration."""
    return [row.what for row in finished_at(parts_of(out), configuration)]


class Parts:
    """What is finished of a file, a part for each name; see `parts_beside`.

    Parameters
    ----------
    store : Store, optional
        Without one nothing is kept.
    names : sequence of str
    """

    def __init__(self, store: Store | None, names: Sequence[str]) -> None:
        self.store, self._names = store, list(names)

    def done(self) -> list[str]:
        """Names of the parts that are there."""
        return [] if self.store is None else [row.what for row in self.store.told()]

    def take(self, name: str, make: Callable[[], xr.Dataset]) -> xr.Dataset:
        """A part: read if it is there, or made and kept; both come the same way."""
        if self.store is None:
            return make()
        place, scratch = self._names.index(name), self.store.scratch
        row = next(self.store.meeting(place, place + 1), None)
        made = make() if row is None else None
        with disk_errors(f"{self.store.path}: finished parts", "run the same again"):
            try:
                if row is not None:
                    scratch.write_bytes(row.results)
                elif made is not None:
                    write_netcdf(made, scratch)
                    with self.store.writing():
                        self.store.put(Tile(place, place + 1), name, scratch.read_bytes())
                return read_netcdf(scratch)
            finally:
                delete(scratch)


@contextmanager
def parts_beside(
    out: Path | None, configuration: Mapping[str, Any], names: Sequence[str], *, force: bool = False
) -> Iterator[Parts]:
    """The parts of a file, in the store ``<out>.parts``, under its lock; the store goes if there are none.

    Parameters
    ----------
    out : Path, optional
    configuration : mapping
    names : sequence of str
        Of all parts.
    force : bool
        See `opened_store`, which also says what is raised.
    """
    if out is None:
        yield Parts(None, names)
        return
    with opened_store(parts_of(out), configuration, len(names), force=force) as store:
        for line in store.trouble:
            warnings.warn(line, RuntimeWarning, stacklevel=5)  # of what has called make_borders
        yield Parts(store, names)

"""Points that existing cubes have already, matched by the exact value of every parameter."""

import json
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.grid import Grid
from dimersweep.cubes.results import Finished, Tile, runs, split
from dimersweep.errors import StoreError
from dimersweep.storage.checking import check_unchanged
from dimersweep.storage.provenance import differences

BLOCK = 1 << 16  # points looked up at a time
_POINTS = ("grid", "fixed", "refine")
Read = Callable[[xr.Dataset], np.ndarray]  # the results of all points that a cube was made of
Pick = Callable[[np.ndarray], np.ndarray]  # some points, bool, by their codes


def _places(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Index in the increasing `old` of each value of `new`, -1 where it is not there bit for bit."""
    old, new = old.astype(float), new.astype(float)  # the codes of directions, too
    found = np.minimum(np.searchsorted(old, new), old.size - 1)
    return np.where(old[found].view(np.int64) == new.view(np.int64), found, -1)


def check_alike(cube: xr.Dataset, new: dict[str, Any], name: str) -> None:
    """Refuse a cube whose points are not those of the configuration `new`.

    Raises
    ------
    StoreError
        If it was made with other settings or another kernel, with the differences.
    """
    old = json.loads(cube.attrs["configuration"])
    if not {"grid", "fixed"} <= set(old):
        raise StoreError(f"{name}: tells a configuration that this version does not know")
    if ("search" in old) != ("search" in new):
        one, other = ("a search", "a whole grid") if "search" in old else ("a whole grid", "a search")
        raise StoreError(f"{name}: is the cube of {one}; it cannot be extended to {other}")
    swept = {*old["grid"], *new["grid"]}

    def settings(configuration: dict[str, Any]) -> dict[str, Any]:
        fixed = {key: value for key, value in configuration["fixed"].items() if key not in swept}
        return {key: value for key, value in configuration.items() if key not in _POINTS} | {"fixed": fixed}

    changes = differences(settings(old), settings(new))
    lacking = {*old["grid"], *old["fixed"]} ^ {*new["grid"], *new["fixed"]}
    if lacking:
        changes.append(f"parameters: {', '.join(sorted(lacking))} in one of them only")
    if changes:
        lines = "".join(f"\n  {line}" for line in changes)
        raise StoreError(f"{name}: cannot be extended to this sweep, as it was made otherwise:{lines}")
    if "direction" in old["grid"]:
        _check_line(old["grid"], new["grid"], name)


def _check_line(old: dict[str, list[float]], new: dict[str, list[float]], name: str) -> None:
    """Refuse to extend lines along which the state is carried: each of their runs depends on those before it."""
    one, other = list(old)[-1], list(new)[-1]
    if one != other:
        raise StoreError(f"{name}: cannot be extended to this sweep, as it carries the state along {one}, not {other}")
    if old[one] != new[other]:
        raise StoreError(
            f"{name}: cannot be extended along {one}, along which it carries the state; its values must be the same"
        )


class Known:
    """The points of a study that `cube` has.

    Parameters
    ----------
    cube : xarray.Dataset
        As `sweep`, `search` or `refine` returned it.
    name : str
        What messages call it.
    grid : Grid
        The points to be; what is an axis in one may be fixed in the other.
    read : callable
        Gives the results of `cube`.
    unwanted : callable
        Which points are not taken over, from codes of shape (n, N_CODES); shape (n,), bool.

    Raises
    ------
    StoreError
        If `cube` was changed since it was written, or has none of the points.
    """

    def __init__(self, cube: xr.Dataset, name: str, grid: Grid, read: Read, unwanted: Pick) -> None:
        check_unchanged(cube, name)
        self.shape, self.line, self.unwanted = grid.shape, grid.line, unwanted
        self.places, self.offset = [np.arange(grid.size)], 0
        if not grid.columns:  # single points are those of the cube: it is made again
            self._find(cube, name, grid)
        self.results = read(cube)

    def _find(self, cube: xr.Dataset, name: str, grid: Grid) -> None:
        """Where the points of a grid are in `cube`."""
        old = json.loads(cube.attrs["configuration"])["grid"]
        strides, stride = {}, 1
        for axis in reversed(old):
            strides[axis], stride = stride, stride * cube.sizes[axis]
        self.places = []
        for axis in {**grid.axes, **old}:
            values = grid.axes.get(axis, grid.fixed.get(axis))
            places = _places(np.atleast_1d(cube[axis].values), np.atleast_1d(np.asarray(values)))
            if (places < 0).all():
                raise StoreError(f"{name}: has no point of this sweep ({axis} has none of its values)")
            numbers = np.where(places < 0, -1, places * strides.get(axis, 0))
            if axis in grid.axes:
                self.places.append(numbers)
            else:
                self.offset += int(numbers[0])

    def pieces(self, ranges: Iterable[Tile]) -> Iterator[Finished]:
        """The known points of `ranges` that are wanted, in whole lines."""
        for tile in split(ranges, self.line * max(1, BLOCK // self.line)):
            parts = np.unravel_index(np.arange(*tile), self.shape)
            columns = [numbers[k] for numbers, k in zip(self.places, parts, strict=True)]
            number = np.sum(columns, axis=0) + self.offset
            there = np.all([column >= 0 for column in columns], axis=0)
            there[there] = ~self.unwanted(self.results["codes"][number[there]])
            there = np.repeat(there.reshape(-1, self.line).all(axis=1), self.line)
            for start, stop in runs(there, tile.start):
                part = number[start - tile.start : stop - tile.start]
                yield Finished(Tile(start, stop), self.results[part])

"""Points that existing cubes have already, matched by the exact value of every parameter."""

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.results import (
    Finished,
    Tile,
    runs,
    split,
)
from dimersweep.errors import StoreError
from dimersweep.storage.checking import check_unchanged
from dimersweep.storage.cubefiles import open_cube
from dimersweep.storage.provenance import differences
from dimersweep.studies.deciding import SearchSpec
from dimersweep.studies.sweep_spec import Spec
from dimersweep.work.options import Options

BLOCK = 1 << 16  # points looked up at a time
_POINTS = ("grid", "fixed", "refine")
Read = Callable[[xr.Dataset], np.ndarray]  # the results of all points that a cube was made of


def _places(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Index in the increasing `old` of each value of `new`, -1 where it is not there bit for bit."""
    old, new = old.astype(float), new.astype(float)  # the codes of directions, too
    found = np.minimum(np.searchsorted(old, new), old.size - 1)
    return np.where(old[found].view(np.int64) == new.view(np.int64), found, -1)


def _refuse_other_settings(old: dict[str, Any], new: dict[str, Any], name: str) -> None:
    swept = {*old["grid"], *new["grid"]}

    def settings(configuration: dict[str, Any]) -> dict[str, Any]:
        fixed = {key: value for key, value in configuration["fixed"].items() if key not in swept}
        return {key: value for key, value in configuration.items() if key not in _POINTS} | {"fixed": fixed}

    if ("search" in old) != ("search" in new):
        one, other = ("a search", "a whole grid") if "search" in old else ("a whole grid", "a search")
        raise StoreError(f"{name}: is the cube of {one}; it cannot be extended to {other}")
    changes = differences(settings(old), settings(new))
    lacking = {*old["grid"], *old["fixed"]} ^ {*new["grid"], *new["fixed"]}
    if lacking:
        changes.append(f"parameters: {', '.join(sorted(lacking))} in one of them only")
    if changes:
        lines = "".join(f"\n  {line}" for line in changes)
        raise StoreError(f"{name}: cannot be extended to this sweep, as it was made otherwise:{lines}")


def _refuse_another_line(old: dict[str, list[float]], new: dict[str, list[float]], name: str) -> None:
    """Refuse to extend lines along which the state is carried: each of their runs depends on those before it."""
    one, other = list(old)[-1], list(new)[-1]
    if one != other:
        raise StoreError(f"{name}: cannot be extended to this sweep, as it carries the state along {one}, not {other}")
    if old[one] != new[other]:
        raise StoreError(
            f"{name}: cannot be extended along {one}, along which it carries the state; its values must be the same"
        )


class Known:
    """The points of a sweep that `cube` has.

    Parameters
    ----------
    cube : xarray.Dataset
        As `sweep`, `search` or `refine` returned it.
    name : str
        What messages call it.
    spec : Spec or SearchSpec
        The sweep to be; what is an axis in one may be fixed in the other.
    read : callable
        Gives the results of `cube`.

    Raises
    ------
    StoreError
        If `cube` was made with other settings or another kernel, with the differences, was changed since it was
        written, or has none of the points.
    """

    def __init__(self, cube: xr.Dataset, name: str, spec: Spec | SearchSpec, read: Read) -> None:
        old, new = json.loads(cube.attrs["configuration"]), spec.configuration()
        if not {"grid", "fixed"} <= set(old):
            raise StoreError(f"{name}: tells a configuration that this version does not know")
        _refuse_other_settings(old, new, name)
        if "direction" in old["grid"]:
            _refuse_another_line(old["grid"], new["grid"], name)
        check_unchanged(cube, name)
        self.shape = spec.grid.shape
        self.offset = 0
        strides, stride = {}, 1
        for axis in reversed(old["grid"]):
            strides[axis], stride = stride, stride * cube.sizes[axis]
        self.places = []
        for axis in {**new["grid"], **old["grid"]}:
            values = spec.grid.axes.get(axis, spec.grid.fixed.get(axis))
            places = _places(np.atleast_1d(cube[axis].values), np.atleast_1d(np.asarray(values)))
            if (places < 0).all():
                raise StoreError(f"{name}: has no point of this sweep ({axis} has none of its values)")
            numbers = np.where(places < 0, -1, places * strides.get(axis, 0))
            if axis in new["grid"]:
                self.places.append(numbers)
            else:
                self.offset += int(numbers[0])
        self.line = spec.grid.line
        self.results = read(cube)

    def pieces(self, ranges: Iterable[Tile], unwanted: Callable[[np.ndarray], np.ndarray]) -> Iterator[Finished]:
        """The known points of `ranges`, without those that `unwanted` picks from their codes."""
        for tile in split(ranges, self.line * max(1, BLOCK // self.line)):
            parts = np.unravel_index(np.arange(*tile), self.shape)
            columns = [numbers[k] for numbers, k in zip(self.places, parts, strict=True)]
            number = np.sum(columns, axis=0) + self.offset
            there = np.all([column >= 0 for column in columns], axis=0)
            there[there] = ~unwanted(self.results["codes"][number[there]])
            for start, stop in runs(there, tile.start):
                part = number[start - tile.start : stop - tile.start]
                yield Finished(Tile(start, stop), self.results[part])


class SamePoints:
    """The points of a cube whose configuration is that of the sweep; see `Known`."""

    def __init__(self, cube: xr.Dataset, name: str, read: Read) -> None:
        check_unchanged(cube, name)
        self.results = read(cube)

    def pieces(self, ranges: Iterable[Tile], unwanted: Callable[[np.ndarray], np.ndarray]) -> Iterator[Finished]:
        """See `Known.pieces`."""
        for tile in ranges:
            part = self.results[tile.start : tile.stop]
            for start, stop in runs(~unwanted(part["codes"]), tile.start):
                yield Finished(Tile(start, stop), self.results[start:stop])


def known_points(
    spec: Spec | SearchSpec, options: Options, read: Read
) -> tuple[list[Known | SamePoints], dict[str, str]]:
    """What other cubes have of the points of `spec`, and the attributes that tell of the first of them.

    These are the cube to extend, and at a retry the one at the output.

    Raises
    ------
    StoreError
        See `Known`.
    """
    found: list[Known | SamePoints] = []
    origin: dict[str, str] = {}
    if options.extend is not None:
        cube = open_cube(options.extend)
        found.append(Known(cube, str(options.extend), spec, read))
        source = f"{Path(options.extend).name}, configuration sha256 {cube.attrs['configuration_sha256']}"
        origin["extends"] = source
    if options.retry and options.out is not None and options.out.exists():
        cube = open_cube(options.out)
        found.append(
            SamePoints(cube, str(options.out), read) if spec.grid.columns else Known(cube, str(options.out), spec, read)
        )
    return found, origin

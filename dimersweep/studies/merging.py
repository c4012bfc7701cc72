"""The cube that the parts of a sweep make, each of them a file of its own."""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.errors import StoreError
from dimersweep.storage.checking import checksum_of
from dimersweep.storage.cubefiles import open_cube, write_cube
from dimersweep.storage.outputs import TABLES, check_output, refuse_input
from dimersweep.storage.provenance import CHECKSUM, OURS, PART, configured, differences
from dimersweep.storage.tilestore import tiles_of
from dimersweep.studies.declared import from_cube
from dimersweep.studies.making import make_cube
from dimersweep.work.parts import Part


def merge(
    parts: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    *,
    finish: bool = False,
    force: bool = False,
    workers: int | None = None,
    client: Any = None,
    progress: bool = True,
) -> xr.Dataset:
    """Make one cube of the parts of a sweep.

    Parameters
    ----------
    parts : iterable of path-like
        Files that ``sweep(..., part=(k, n))`` has written, of all n parts, in any order.
    out : path-like, optional
        NetCDF file to write the cube to.
    finish : bool
        Whether parts that are missing are made first, beside those that are given; one that was stopped goes on.
    force : bool
        Whether `out` may replace an existing file.
    workers, client, progress
        For the parts that are made, as in `sweep`.

    Returns
    -------
    xarray.Dataset
        The cube that one sweep of all points gives: the same values, coordinates and configuration. It tells the time of
        its longest part as `wall_time_s`, and the sum of all as `kernel_time_s`.

    Raises
    ------
    ParameterError
        If `out` is a part, or no NetCDF file.
    StoreError
        If a file is no part, or is damaged; if parts are missing, given twice, or made otherwise than the first one; or if
        `out` exists. Nothing is written then.
    UnfinishedError, Stopped
        With `finish`, as by `sweep`.

    Examples
    --------
    >>> from dimersweep import merge, sweep
    >>> for k in 1, 2:
    ...     part = sweep({"Gamma": [0.6, 0.9]}, periods=60, progress=False, out="two.nc", part=(k, 2))
    >>> cube = merge(["two.part-1-of-2.nc", "two.part-2-of-2.nc"], "both.nc")
    >>> cube["mode"].values.tolist()
    [2, 3]
    """
    paths = [Path(each) for each in parts]
    if not paths:
        raise StoreError("merge: no part was given")
    if out is not None:
        check_output(out, force=force, endings=TABLES)
        for path in paths:
            refuse_input(Path(out), path)
    merging = _Merging(paths[0])
    for path in paths:
        merging.take(path)
    for part, name in merging.lacking() if finish else ():
        attrs = {key: value for key, value in merging.cube.attrs.items() if key not in OURS}
        study, number = from_cube(paths[0]).study(), (part.number, part.total)
        make_cube(study, out=name, part=number, attrs=attrs, workers=workers, client=client, progress=progress)
        merging.take(part.file(name))
    if lacking := merging.lacking():
        begun = [" (begun)" if tiles_of(part.file(name)).exists() else "" for part, name in lacking]
        told = ", ".join(f"{part}{more}" for (part, _), more in zip(lacking, begun, strict=True))
        raise StoreError(
            f"{paths[0]}: these parts are missing: {told}; make them, or have them made here (finish=True)"
        )
    cube = merging.cube
    cube.attrs |= configured(_settings(cube))
    del cube.attrs[CHECKSUM]
    cube.attrs[CHECKSUM] = checksum_of(cube)
    if out is not None:
        write_cube(cube, out, force=force)
    return cube


class _Merging:
    """Parts put together: `cube` has the points of those that are `there`."""

    def __init__(self, first: Path) -> None:
        self.first, self.cube = first, open_cube(first)
        self.part = _part_of(self.cube, first)
        self.there: dict[int, Path] = {}

    def take(self, path: Path) -> None:
        """Take over the points of a part.

        Raises
        ------
        StoreError
            If it does not go with those that are there.
        """
        cube = open_cube(path)
        part, both = _part_of(cube, path), f"{self.first} and {path}"
        if part.total != self.part.total:
            raise StoreError(f"{both}: are parts of {self.part.total} and of {part.total}")
        if changes := differences(_settings(self.cube), _settings(cube)):
            raise StoreError(f"{both}: are parts of different sweeps ({'; '.join(changes)})")
        if part.number in self.there:
            raise StoreError(f"{self.there[part.number]} and {path}: are the same part, {part}")
        self.there[part.number] = path
        ours, shape = self.cube.attrs, cube["mode"].shape
        line = shape[-1] if "direction" in cube.dims else 1  # as of `Grid`
        points = np.concatenate([np.arange(*tile) for tile in part.ranges(cube["mode"].size, line)])
        where = np.unravel_index(points, shape)
        for name, variable in cube.data_vars.items():
            if variable.shape[: len(shape)] == shape:
                self.cube[name].values[where] = variable.values[where]
        if len(self.there) > 1:
            ours["kernel_time_s"] += cube.attrs["kernel_time_s"]
            ours["wall_time_s"] = max(ours["wall_time_s"], cube.attrs["wall_time_s"])

    def lacking(self) -> list[tuple[Part, Path]]:
        """Return the parts that are missing, and the cube that each is made for, beside the first one that was given."""
        whole = self.first.with_name(self.first.name.replace(f".{self.part.word}", "", 1))
        numbers = sorted({*range(1, self.part.total + 1)} - {*self.there})
        return [(Part(number, self.part.total), whole) for number in numbers]


def _part_of(cube: xr.Dataset, path: Path) -> Part:
    told = json.loads(cube.attrs["configuration"]).get(PART)
    if told is None:
        raise StoreError(f"{path}: is no part of a sweep, but a whole cube")
    return Part.of(told)


def _settings(cube: xr.Dataset) -> dict[str, Any]:
    """Return the configuration of all parts of a sweep."""
    return {name: value for name, value in json.loads(cube.attrs["configuration"]).items() if name != PART}

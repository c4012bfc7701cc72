"""Merge the parts of a sweep, each of which is a file of its own, into one cube."""

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
from dimersweep.work.parts import SweepPart


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
    """Merge the parts of a sweep into one cube.

    Parameters
    ----------
    parts : iterable of path-like
        Files of all n parts, which ``sweep(..., part=(k, n))`` has written, in any order.
    out : path-like, optional
        NetCDF file to write the cube to; `force` lets it replace one that exists.
    finish : bool
        If True, missing parts are made first, in the folder of the first part, with `workers`, `client` and `progress`
        as in `sweep`. A part that was stopped is resumed.

    Returns
    -------
    xarray.Dataset
        The cube that one sweep of all points gives: the same values, coordinates and configuration. Its `wall_time_s`
        is that of the longest part, its `kernel_time_s` the sum of all parts.

    Raises
    ------
    ParameterError, StoreError
        If a file is no part, or is damaged. If parts are missing, come twice, or belong to another sweep than the first
        one. If `out` is a part, exists, or is no NetCDF file. No file is written then. With `finish` also the errors of
        `sweep`.

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
    first, there = paths[0], dict[int, Path]()
    cube = open_cube(first)
    for path in paths:
        _take(cube, path, there, first)
    own, settings = _part_and_settings(cube, first)
    whole = first.with_name(first.name.replace(f".part-{own.number}-of-{own.total}", "", 1))
    lacking = [SweepPart(number, own.total) for number in range(1, own.total + 1) if number not in there]
    for part in lacking if finish else ():
        attrs, study = {key: value for key, value in cube.attrs.items() if key not in OURS}, from_cube(first).study()
        make_cube(study, out=whole, part=str(part), attrs=attrs, workers=workers, client=client, progress=progress)
        _take(cube, part.file(whole), there, first)
    if lacking and not finish:
        missing = ", ".join(f"{part}{' (begun)' * tiles_of(part.file(whole)).exists()}" for part in lacking)
        raise StoreError(
            f"{first}: these parts are missing: {missing}; make them, or have them made here (finish=True)"
        )
    cube.attrs |= configured(settings)
    cube.attrs[CHECKSUM] = checksum_of(cube)
    if out is not None:
        write_cube(cube, out, force=force)
    return cube


def _take(cube: xr.Dataset, path: Path, there: dict[int, Path], first: Path) -> None:
    """Put the points of the part at `path` into the cube, which is that of the `first` part; refuse a part of another
    sweep.
    """
    other = open_cube(path)
    (own, settings), (part, others) = _part_and_settings(cube, first), _part_and_settings(other, path)
    both = f"{first} and {path}"
    if part.total != own.total:
        raise StoreError(f"{both}: are parts of {own.total} and of {part.total}")
    if changes := differences(settings, others):
        raise StoreError(f"{both}: are parts of different sweeps ({'; '.join(changes)})")
    if part.number in there:
        raise StoreError(f"{there[part.number]} and {path}: are the same part, {part}")
    shape = cube["mode"].shape
    line = shape[-1] if "direction" in cube.dims else 1  # as `Grid.line`: parts have whole lines
    points = np.concatenate([np.arange(*tile) for tile in part.ranges(cube["mode"].size, line)])
    where = np.unravel_index(points, shape)
    for name, variable in other.data_vars.items():
        if variable.shape[: len(shape)] == shape:
            cube[name].values[where] = variable.values[where]
    if there:
        cube.attrs["kernel_time_s"] += other.attrs["kernel_time_s"]
        cube.attrs["wall_time_s"] = max(cube.attrs["wall_time_s"], other.attrs["wall_time_s"])
    there[part.number] = path


def _part_and_settings(cube: xr.Dataset, path: Path) -> tuple[SweepPart, dict[str, Any]]:
    """Return which part of a sweep a cube is, and the configuration of all parts; raise a StoreError if it is none."""
    settings = json.loads(cube.attrs["configuration"])
    if PART not in settings:
        raise StoreError(f"{path}: is no part of a sweep, but a whole cube")
    return SweepPart.of(settings.pop(PART)), settings

"""Reuse what is there already: a complete cube at the output, and points of other cubes."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from dimersweep.cubes.cube import flatten
from dimersweep.cubes.results import Finished, Tile, chunks, failed, not_ok, not_run, pieces
from dimersweep.errors import ParameterError, StoreError
from dimersweep.storage.checking import check_unchanged
from dimersweep.storage.cubefiles import open_cube
from dimersweep.storage.formats import format_of
from dimersweep.storage.outputs import check_output
from dimersweep.storage.provenance import PART, as_text, differences
from dimersweep.studies.study import Study
from dimersweep.work.options import Options

# points of other cubes that are looked up at a time: the arrays of their indices take some MB, however large the grid
BLOCK = 1 << 16
# items of a configuration that say which points there are, and not how each of them is run
_POINTS = ("grid", "fixed", "refine", PART)

# tells which results of another cube stand, as `Study.stands` does
Stands = Callable[[np.ndarray, np.ndarray], np.ndarray]
# looks up the results that another cube has of some ranges of points, and yields those that stand
Known = Callable[[Iterable[Tile], Stands], Iterator[Finished]]


def complete_cube(study: Study, options: Options) -> xr.Dataset | None:
    """Return the cube of `study` if it is at the output, with nothing to retry, else None; check the output.

    Raises
    ------
    ParameterError, StoreError
        If there is another cube, or the output cannot be written.
    """
    out = options.out
    written = format_of(out or Path())
    if not written.write_blocks:
        study.check_fits()
    elif not study.by_blocks:
        raise ParameterError(
            f"out = {out}: only a sweep of a whole grid with one number for each variable is written as {written.name}; "
            "give a NetCDF file"
        )
    written.check()
    if out is None:
        if options.retry and options.extend is None:
            raise ParameterError("retry: needs an out, or a cube to extend")
        return None
    check_output(out, force=True)  # first of all: a place that can never be written to
    if out.exists() and not options.force:
        former = _former(out, study)
        if not options.retry or not failed(flatten(former)[1]).any():
            if options.progress:
                print(f"{out}: is complete already; nothing was run", file=sys.stderr, flush=True)
            return former
    return None


def _former(out: Path, study: Study) -> xr.Dataset:
    """Return the cube that is at `out` already, if it is the cube that `study` would give.

    Raises
    ------
    StoreError
        If it is another cube, was changed, or cannot be read.
    """
    other = "give another name, or force it to be replaced (force=True)"
    try:
        cube = open_cube(out)
        old, new = json.loads(cube.attrs["configuration"]), study.configuration()
        if as_text(old) == as_text(new):
            check_unchanged(cube, out)
            return cube
    except StoreError as error:
        raise StoreError(f"out = {out}: exists already, and cannot be used ({error}); {other}") from None
    changes = "".join(f"\n  {line}" for line in differences(old, new))
    raise StoreError(f"out = {out}: exists already; {other}. What differs:{changes}")


def known_points(study: Study, options: Options) -> tuple[list[Known], dict[str, str]]:
    """Return functions that look up points of `study` in other cubes, and the attributes that name the extended cube.

    Other cubes are the cube to extend and, at a retry, the cube at the output.

    Raises
    ------
    StoreError
        See `check_alike` and `points_in`.
    """
    origin: dict[str, str] = {}
    known = []
    paths = [options.extend, options.out if options.retry and options.out and options.out.exists() else None]
    for path in (each for each in paths if each is not None):
        cube, name = open_cube(path), str(path)
        if not study.grid.columns:
            check_alike(cube, study.configuration(), name)
        known.append(points_in(cube, name, study, not_ok if options.retry else not_run))
        if path is options.extend:
            origin["extends"] = f"{Path(path).name}, configuration sha256 {cube.attrs['configuration_sha256']}"
    return known, origin


def check_alike(cube: xr.Dataset, new: dict[str, Any], name: str) -> None:
    """Refuse a cube whose points were not run as the configuration `new` would run them.

    Raises
    ------
    StoreError
        If the cube was made with other settings or another kernel; the message lists the differences.
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
    if "direction" in old["grid"]:  # along a line each run depends on those before it
        (one, values), (other, theirs) = (list(each["grid"].items())[-1] for each in (old, new))
        if one != other:
            raise StoreError(
                f"{name}: cannot be extended to this sweep, as it carries the state along {one}, not {other}"
            )
        if values != theirs:
            raise StoreError(
                f"{name}: cannot be extended along {one}, along which it carries the state; its values must be the same"
            )


def _places(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return the index in `old` of each value of `new`, -1 where `old` has no value with the same bits."""
    # as floats, since the axis `direction` holds integer codes; their bits are compared as integers
    there, wanted = (each.astype(float).view(np.int64) for each in (old, new))
    return pd.Index(there).get_indexer(wanted)


def points_in(cube: xr.Dataset, name: str, study: Study, unwanted: Callable[[np.ndarray], np.ndarray]) -> Known:
    """Return a function that looks up points of a study in `cube`.

    A parameter that is an axis in one of them may be fixed in the other.

    Parameters
    ----------
    cube : xarray.Dataset
        Cube of `sweep`, `search` or `refine`.
    name : str
        Name of the cube in messages.
    study : Study
    unwanted : callable
        Returns True for points that are not taken over, shape (n,), from their codes, shape (n, N_CODES).

    Returns
    -------
    callable
        Yields the points of the cube that lie in some ranges, in whole lines.

    Raises
    ------
    StoreError
        If `cube` was changed since it was written, or has none of the points.
    """
    check_unchanged(cube, name)
    grid, line, offset = study.grid, study.line, 0
    # a point of the study has the number `offset` plus one number for its place on each axis in the cube, -1 if it is
    # not there; single points have their own numbers, as only the same table (a retry) is looked up
    along = [np.arange(grid.size)]
    if not grid.columns:
        old = json.loads(cube.attrs["configuration"])["grid"]
        strides, stride, along = {}, 1, []
        for axis in reversed(old):
            strides[axis], stride = stride, stride * cube.sizes[axis]
        for axis in {**grid.axes, **old}:
            values = grid.axes.get(axis, grid.fixed.get(axis))
            places = _places(np.atleast_1d(cube[axis].values), np.atleast_1d(np.asarray(values)))
            if (places < 0).all():
                raise StoreError(f"{name}: has no point of this sweep ({axis} has none of its values)")
            numbers = np.where(places < 0, -1, places * strides.get(axis, 0))
            if axis in grid.axes:
                along.append(numbers)
            else:
                offset += int(numbers[0])
    results = study.results_of(cube)

    def known(ranges: Iterable[Tile], stands: Stands) -> Iterator[Finished]:
        for points in chunks(ranges, lambda: BLOCK, line):
            parts = np.unravel_index(points, grid.shape)
            columns = [numbers[k] for numbers, k in zip(along, parts, strict=True)]
            here = np.sum(columns, axis=0) + offset
            there = np.all([column >= 0 for column in columns], axis=0)
            there[there] = ~unwanted(results["codes"][here[there]])
            there[there] = stands(points[there], results[here[there]])
            # a line is taken whole or not at all, as each of its runs starts from the one before it
            there = np.repeat(there.reshape(-1, line).all(axis=1), line)
            yield from pieces(points[there], results[here[there]])

    return known

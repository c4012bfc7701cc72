"""A whole sweep: a grid in, a labelled cube out; dask owns the cores, the calling thread all bookkeeping and files."""

import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from time import perf_counter
from typing import Any

import dask
import xarray as xr
from dask.callbacks import Callback
from dask.system import CPU_COUNT

from dimersweep.cube import blank, build
from dimersweep.grid import make_grid
from dimersweep.kernel.layout import CODES
from dimersweep.parameters import check_count, check_rtol
from dimersweep.progress import tell_of_compiling, watch
from dimersweep.provenance import attributes
from dimersweep.store import check_writable, write_cube
from dimersweep.tiles import Finished, Spec, Tile, attempt, split, tile_length

_MODE = CODES.index("mode")


def run_tiles(spec: Spec, tiles: Iterable[Tile], workers: int, take: Callable[[Finished], None]) -> None:
    """Run `tiles` on `workers` threads and hand each to `take`, in the calling thread, as it finishes."""

    def posttask(key: Any, result: Any, dsk: Any, state: Any, worker: Any) -> None:
        take(result)

    task = dask.delayed(partial(attempt, spec), name="tile", pure=False)
    with Callback(posttask=posttask):
        dask.compute([task(tile) for tile in tiles], scheduler="threads", num_workers=workers)


def sweep(
    grid: Mapping[str, Any],
    fixed: Mapping[str, Any] | None = None,
    *,
    periods: int,
    rtol: float = 1e-8,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    progress: bool = True,
    stop_when_settled: bool = True,
    force: bool = False,
    attrs: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Run the dimer at every point of a grid.

    Parameters
    ----------
    grid : mapping of str to array_like or mapping
        The axes: a parameter's name (see `Parameters`) and its values, or ``{"start", "stop", "step" or "num"}`` with
        the stop included; ``"unit": "deg"`` for angles in degrees. SI units otherwise.
    fixed : mapping of str to float, optional
        Parameters that differ from the paper's base case.
    periods : int
        Forcing periods each point may take.
    rtol : float
        Accuracy [1], 1e-13 to 1e-2.
    out : path-like, optional
        NetCDF file to write the cube to; written whole at the end or not at all.
    workers : int, optional
        Threads; by default one for each core.
    progress : bool
        Whether to show finished points, time left and a tally of modes on stderr.
    stop_when_settled : bool
        Whether a point stops as soon as its motion has settled.
    force : bool
        Whether `out` may replace an existing file.
    attrs : mapping of str to str, optional
        Further global attributes, such as a title.

    Returns
    -------
    xarray.Dataset
        `mode`, `status`, orbit quantities and counts over the axes, with units and provenance. The numbers depend
        neither on `workers` nor on how the grid is cut into tiles.

    Raises
    ------
    ParameterError
        For a grid, a parameter or a setting that is not allowed, before any work.
    StoreError
        For an `out` that cannot be written, before any work.
    """
    spec = Spec(make_grid(grid, fixed), check_count("periods", periods), check_rtol(rtol), bool(stop_when_settled))
    workers = CPU_COUNT if workers is None else check_count("workers", workers)
    if out is not None:
        check_writable(out, force=force)
    started = perf_counter()
    results, codes = blank(spec.grid.size)
    errors: list[str] = []

    def take(finished: Finished) -> None:
        where = slice(*finished.tile)
        results[where], codes[where] = finished.out, finished.codes
        shown.add(finished.codes[:, _MODE])
        if finished.error:
            errors.append(f"points {where.start} to {where.stop - 1}: {finished.error}")

    if progress:
        tell_of_compiling()
    tiles = split(spec.grid.size, tile_length(spec, workers))  # compiles: do it before the clock of the progress starts
    with watch(spec.grid.size, show=progress) as shown:
        run_tiles(spec, tiles, workers, take)
    if errors:
        warnings.warn(f"{len(errors)} tiles failed; {errors[0]}", RuntimeWarning, stacklevel=2)
    told = attributes(spec.configuration(), "sweep of a 3D dimer on a vibrating plate", perf_counter() - started)
    cube = build(
        spec.grid, results, codes, told | dict(attrs or {}) | ({"failures": "; ".join(errors)} if errors else {})
    )
    if out is not None:
        write_cube(cube, out, force=force)
    return cube

"""A declared search or refined map made into its cube, the paths of its runs included."""

import json
from pathlib import Path
from typing import Any

import xarray as xr
from dask.system import CPU_COUNT

from dimersweep.declaration import Declaration
from dimersweep.paths import add_paths
from dimersweep.provenance import configured
from dimersweep.refining import refine
from dimersweep.searching import search
from dimersweep.store import check_writable, write_cube


def make(
    declared: Declaration,
    out: Path,
    *,
    periods: int,
    rtol: float,
    workers: int | None = None,
    force: bool = False,
    progress: bool = True,
) -> xr.Dataset:
    """Make the cube of a declaration that has a ``[search]``, and write it.

    Parameters
    ----------
    declared : Declaration
    out : path-like
        NetCDF file.
    periods, rtol : int, float
        In place of the declared ones.
    workers, force, progress
        As in `sweep`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ParameterError, StoreError
        As by `search` and `refine`.
    """
    assert declared.search is not None
    check_writable(out, force=force)
    asked = declared.search.model_dump()
    attrs = {"title": declared.sweep.title, "plot": declared.plot.kind}
    how: dict[str, Any] = {"periods": periods, "rtol": rtol, "workers": workers, "progress": progress, "attrs": attrs}
    if declared.refine is not None:
        asked.pop("orbit_periods")
        cube = refine(declared.grid, declared.fixed, **declared.refine.model_dump(), **asked, **how)
    else:
        cube = search(declared.grid, declared.fixed, **asked, **how)
    if declared.paths is not None:
        kept = declared.paths.model_dump()
        cube = add_paths(cube, **kept, rtol=rtol, workers=workers or CPU_COUNT)
        cube.attrs |= configured(json.loads(cube.attrs["configuration"]) | {"paths": kept})
    write_cube(cube, out, force=force)
    return cube

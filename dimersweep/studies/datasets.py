"""What a file declares, made into its cube."""

from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.studies.declaration import Declaration
from dimersweep.studies.making import Output
from dimersweep.studies.making import make as make_cube
from dimersweep.work.computing import make_how


def make(
    declared: Declaration,
    out: Path | None,
    *,
    periods: int | None = None,
    rtol: float | None = None,
    extend: Path | None = None,
    retry: bool = False,
    certify: bool = False,
    workers: int | None = None,
    client: Any = None,
    progress: bool = True,
    fail_fast: bool = False,
    force: bool = False,
    keep_tiles: bool = False,
) -> xr.Dataset:
    """Make the cube of a declaration, and write it.

    Parameters
    ----------
    declared : Declaration
    out : path-like, optional
        Cube to be.
    periods, rtol : int, float, optional
        In place of the declared ones.
    extend, retry, certify, workers, client, progress, fail_fast, force, keep_tiles
        As in `sweep`; a search takes no `certify`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ParameterError, StoreError, PointError, Stopped
        As by `sweep`.
    """
    job = declared.job(periods=periods, rtol=rtol, extend=extend, retry=retry, certify=certify)
    how = make_how(workers, client, progress=progress, fail_fast=fail_fast)
    return make_cube(job, how, Output(out, force=force, keep_tiles=keep_tiles, attrs=declared.attrs))

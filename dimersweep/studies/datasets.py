"""What a file declares, made into its cube."""

import os
from typing import Any

import xarray as xr

from dimersweep.studies.declaration import Declaration
from dimersweep.studies.making import make_cube


def make(
    declared: Declaration,
    out: str | os.PathLike[str] | None,
    *,
    periods: int | None = None,
    rtol: float | None = None,
    certify: bool = False,
    **options: Any,
) -> xr.Dataset:
    """Make the cube of a declaration, and write it.

    Parameters
    ----------
    declared : Declaration
    out : path-like, optional
        File of the cube.
    periods, rtol : int, float, optional
        In place of the declared ones.
    certify : bool
        As in `sweep`; a search takes none.
    **options
        As in `sweep`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    ParameterError, StoreError, PointError, UnfinishedError, Stopped
        As by `sweep`.

    Examples
    --------
    >>> from pathlib import Path
    >>> from dimersweep.studies.datasets import make
    >>> from dimersweep.studies.declaration import read_declaration
    >>> from dimersweep.studies.presets import find_declaration
    >>> declared = read_declaration(find_declaration(Path("fig07-small")))
    >>> cube = make(declared, "small.nc", periods=60, progress=False, force=True)
    >>> dict(cube.sizes)
    {'f': 3, 'beta0': 44}
    """
    study = declared.study(periods=periods, rtol=rtol, certify=certify)
    options.setdefault("attrs", declared.attrs)
    return make_cube(study, out=out, **options)

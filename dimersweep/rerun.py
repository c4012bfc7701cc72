"""A cube made again from its provenance: the declaration that it tells to have come from."""

import json
import os

from pydantic import ValidationError

from dimersweep.declaration import Declaration, PlotSection, SweepSection
from dimersweep.errors import StoreError
from dimersweep.provenance import differences
from dimersweep.store import open_cube
from dimersweep.tiles import Spec

MADE_BY = ("source", "git_commit", "python", "numpy", "numba", "cpu")


def from_cube(path: str | os.PathLike[str], *, other_kernel: bool = False) -> Declaration:
    """The declaration that gives the cube at `path` again, from what the cube tells of itself.

    Parameters
    ----------
    path : path-like
    other_kernel : bool
        Whether the cube may come from another kernel than this program's, or be configured in ways that it does not
        know.

    Returns
    -------
    Declaration

    Raises
    ------
    StoreError
        If there is no such cube, or it comes from another kernel; with the versions that made it.
    """
    cube = open_cube(path)
    told = json.loads(cube.attrs["configuration"])
    try:
        declaration = Declaration(
            sweep=SweepSection(
                title=cube.attrs["title"],
                periods=told["periods"],
                rtol=told["rtol"],
                stop_when_settled=told["stop_when_settled"],
                output=str(path),
            ),
            grid=told["grid"],
            fixed=told["fixed"],
            plot=PlotSection(kind=cube.attrs.get("plot", "mode_map")),
        )
    except (KeyError, ValidationError) as error:
        raise StoreError(f"{path}: tells a configuration that this version does not know ({error})") from None
    changes = differences(told, Spec.from_configuration(told).configuration())
    if changes and not other_kernel:
        made_by = ", ".join(f"{name} {cube.attrs.get(name, 'unknown')}" for name in MADE_BY)
        raise StoreError(
            f"{path}: was made by another version, so its numbers may differ in the last digits; install that one "
            f"({made_by}), or go on with --other-kernel. What differs:" + "".join(f"\n  {line}" for line in changes)
        )
    return declaration

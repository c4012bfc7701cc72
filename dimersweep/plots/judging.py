"""What each kind of picture needs of a cube, known before the cube is: its axes, and what was asked."""

from collections.abc import Collection, Mapping
from typing import get_args

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import check_codes
from dimersweep.errors import ParameterError
from dimersweep.symbols import PARAMETERS, Picture

PICTURE_KINDS = get_args(Picture)
EXACT_AXES = {"trends": ("A_r", "f"), "minimum": ("A_r", "xdot0"), "impact_ends": ("A_r", "mu", "mu_s")}


def features(cube: xr.Dataset) -> set[str]:
    """What a cube has besides modes and orbits: regions and runs of a search, paths, strobes."""
    marks = {"search": "region", "paths": "x", "strobes": "strobe", "points": "point"}
    return {name for name, variable in marks.items() if variable in cube.variables or variable in cube.dims}


def judge(kind: str, sizes: Mapping[str, int], has: Collection[str] = ()) -> None:
    """Refuse a kind of picture for a cube that it could not draw.

    Parameters
    ----------
    kind : str
        One of `PICTURE_KINDS`.
    sizes : mapping of str to int
        Axes of the cube and how many values each has.
    has : collection of str
        See `features`.

    Raises
    ------
    ParameterError
        Naming what the kind needs.
    """
    if kind not in PICTURE_KINDS:
        raise ParameterError(f"kind = {kind!r}: must be one of {', '.join(PICTURE_KINDS)}")
    for name, n in sizes.items():
        if n == 0:
            raise ParameterError(f"{kind}: the axis {name} is empty")
    axes = [name for name, n in sizes.items() if n > 1]
    axes_words = f"{kind}: has axes {', '.join(axes) or 'none'}; "
    if kind == "segments" and not (1 <= len(axes) <= 2 and "beta0" in axes):
        raise ParameterError(axes_words + ("needs beta0 among them" if 1 <= len(axes) <= 2 else "draws 1 to 2 of them"))
    if kind == "mode_map" and not axes:
        raise ParameterError(axes_words + "needs one of more than one value")
    if kind == "regions" and not ("search" in has and len(axes) == 2):
        raise ParameterError("regions: needs the regions of a search over two axes")
    if kind in EXACT_AXES:
        present = sorted({*axes, *(name for name in sizes if name in EXACT_AXES[kind])})
        if set(present) != set(EXACT_AXES[kind]):
            raise ParameterError(
                f"{kind}: has axes {', '.join(present) or 'none'}; needs {', '.join(EXACT_AXES[kind])}"
            )
    if kind == "shares" and not ("search" in has and len(sizes) == 2):
        raise ParameterError("shares: needs the runs of a search over two axes")
    if kind in ("paths", "walks", "planar") and not ("paths" in has and len(sizes) == 1):
        words = "needs paths over one axis" if kind == "planar" else "the cube has no paths over one axis"
        raise ParameterError(f"{kind}: {words}; declare [paths]")
    if kind == "bifurcation" and "strobes" not in has:
        raise ParameterError("bifurcation: the cube has no strobes; make it with bifurcation(...)")


def judge_cube(kind: str, cube: xr.Dataset) -> None:
    """Refuse a kind of picture that `cube` cannot fill."""
    if not isinstance(cube, xr.Dataset):
        raise ParameterError(f"cube: is a {type(cube).__name__}; give a cube")
    check_codes(cube["mode"])
    check_axes(cube)
    judge(kind, {str(name): n for name, n in cube["mode"].sizes.items()}, features(cube))


def check_axes(cube: xr.Dataset) -> None:
    """Refuse a cube whose points have no places: an axis that is no parameter, has lost its values or has them in no order.

    Raises
    ------
    ParameterError
    """
    for name, n in cube["mode"].sizes.items():
        if n < 2 or name == "point":
            continue
        if name not in {*PARAMETERS, "direction"} or name not in cube.coords:
            raise ParameterError(
                f"plot: the axis {name} is no parameter, or has lost its values; give the cube as it was made"
            )
        steps = np.diff(cube[name].values)
        if not ((steps > 0).all() or (steps < 0).all()):
            raise ParameterError(
                f"plot: the values of the axis {name} are in no order, or not each there once; sort them"
            )

"""What each kind of picture needs of a cube, known before the cube is: its axes, and what was asked."""

from collections.abc import Callable, Collection, Mapping
from typing import get_args

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import check_codes
from dimersweep.errors import ParameterError
from dimersweep.symbols import PARAMETERS, Picture

PICTURE_KINDS = get_args(Picture)


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
    lack = _LACKS[kind](sizes, has)
    if lack:
        raise ParameterError(f"{kind}: {lack}")


Lack = Callable[[Mapping[str, int], Collection[str]], str]  # what is wrong with axes and features; "" if nothing is


def _wide(sizes: Mapping[str, int]) -> list[str]:
    return [name for name, n in sizes.items() if n > 1]


def _has_axes(axes: Collection[str], need: str) -> str:
    return f"has axes {', '.join(axes) or 'none'}; {need}"


def _of_segments(sizes: Mapping[str, int], has: Collection[str]) -> str:
    axes = _wide(sizes)
    if not 1 <= len(axes) <= 2:
        return _has_axes(axes, "draws 1 to 2 of them")
    return "" if "beta0" in axes else _has_axes(axes, "needs beta0 among them")


def _exactly(*wanted: str) -> Lack:
    """Just these axes of more than one value."""

    def lack(sizes: Mapping[str, int], has: Collection[str]) -> str:
        present = sorted({*_wide(sizes), *(name for name in sizes if name in wanted)})
        return "" if set(present) == set(wanted) else _has_axes(present, f"needs {', '.join(wanted)}")

    return lack


def _paths(words: str) -> Lack:
    return lambda sizes, has: "" if "paths" in has and len(sizes) == 1 else f"{words}; declare [paths]"


_NO_PATHS = "the cube has no paths over one axis"
_LACKS: dict[str, Lack] = {
    "segments": _of_segments,
    "mode_map": lambda sizes, has: "" if _wide(sizes) else _has_axes((), "needs one of more than one value"),
    "regions": lambda sizes, has: (
        "" if "search" in has and len(_wide(sizes)) == 2 else "needs the regions of a search over two axes"
    ),
    "shares": lambda sizes, has: (
        "" if "search" in has and len(sizes) == 2 else "needs the runs of a search over two axes"
    ),
    "trends": _exactly("A_r", "f"),
    "minimum": _exactly("A_r", "xdot0"),
    "impact_ends": _exactly("A_r", "mu", "mu_s"),
    "paths": _paths(_NO_PATHS),
    "walks": _paths(_NO_PATHS),
    "planar": _paths("needs paths over one axis"),
    "bifurcation": lambda sizes, has: (
        "" if "strobes" in has else "the cube has no strobes; make it with bifurcation(...)"
    ),
}


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

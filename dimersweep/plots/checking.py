"""Check that a cube has the axes and results that a kind of picture needs, also before the cube is made."""

from collections.abc import Collection, Mapping

import numpy as np
import xarray as xr

from dimersweep.cubes.cube import check_codes
from dimersweep.errors import ParameterError
from dimersweep.symbols import PARAMETERS, PICTURE_KINDS

# kinds that need exactly these axes of more than one value
AXES = {
    "trends": ("A_r", "f"),
    "minimum": ("A_r", "xdot0"),
    "impact_ends": ("A_r", "mu", "mu_s"),
}
_NO_PATHS = "the cube has no paths over one axis; declare [paths]"
# kind: the feature that it needs; True if axes of one value do not count; how many axes it needs; the refusal if it
# lacks them
FEATURES: dict[str, tuple[str, bool, int | None, str]] = {
    "regions": ("search", True, 2, "needs the regions of a search over two axes"),
    "shares": ("search", False, 2, "needs the runs of a search over two axes"),
    "paths": ("paths", False, 1, _NO_PATHS),
    "walks": ("paths", False, 1, _NO_PATHS),
    "planar": ("paths", False, 1, "needs paths over one axis; declare [paths]"),
    "bifurcation": ("strobes", False, None, "the cube has no strobes; make it with bifurcation(...)"),
    "circles": ("sustained", False, None, "the cube has no sustained spins; make it with sweep(..., sustained=True)"),
}


def features(cube: xr.Dataset) -> set[str]:
    """Return the features of a cube besides modes and orbits.

    They are regions and runs of a search, paths, strobes, and sustained spins.
    """
    marks = {"search": "region", "paths": "x", "strobes": "strobe", "sustained": "sustained_spin"}
    return {name for name, variable in marks.items() if variable in cube.variables or variable in cube.dims}


def check(kind: str, sizes: Mapping[str, int], has: Collection[str] = ()) -> None:
    """Refuse a kind of picture for a cube that it could not draw.

    Parameters
    ----------
    kind : str
        One of `PICTURE_KINDS`.
    sizes : mapping of str to int
        Number of values of each axis of the cube.
    has : collection of str
        Features of the cube, see `features`.

    Raises
    ------
    ParameterError
        Naming the axes or features that the kind needs.
    """
    if kind not in PICTURE_KINDS:
        raise ParameterError(f"kind = {kind!r}: must be one of {', '.join(PICTURE_KINDS)}")
    for name, n in sizes.items():
        if n == 0:
            raise ParameterError(f"{kind}: the axis {name} is empty")
    if lack := _lack(kind, sizes, has):
        raise ParameterError(f"{kind}: {lack}")


def _lack(kind: str, sizes: Mapping[str, int], has: Collection[str]) -> str:
    """Return words for what a kind of picture lacks in a cube of these sizes and features; "" if nothing."""
    axes = [name for name, n in sizes.items() if n > 1]
    need = ""
    if kind in FEATURES:
        feature, squeezed, n, words = FEATURES[kind]
        there = len(axes) if squeezed else len(sizes)
        return "" if feature in has and n in (None, there) else words
    if kind in AXES:
        axes = sorted({*axes, *(name for name in sizes if name in AXES[kind])})
        need = "" if set(axes) == set(AXES[kind]) else f"needs {', '.join(AXES[kind])}"
    elif kind == "mode_map":
        need = "" if axes else "needs one of more than one value"
    elif not 1 <= len(axes) <= 2:
        need = "draws 1 to 2 of them"
    elif "beta0" not in axes:
        need = "needs beta0 among them"
    return need and f"has axes {', '.join(axes) or 'none'}; {need}"


def check_cube(kind: str, cube: xr.Dataset) -> None:
    """Refuse a kind of picture that `cube` has not the axes or results for."""
    if not isinstance(cube, xr.Dataset):
        raise ParameterError(f"cube: is a {type(cube).__name__}; give a cube")
    check_codes(cube["mode"])
    check_axes(cube)
    check(kind, {str(name): n for name, n in cube["mode"].sizes.items()}, features(cube))


def check_axes(cube: xr.Dataset) -> None:
    """Refuse a cube whose points have no place in a picture.

    An axis is no parameter, has lost its values, or has them in no order.

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

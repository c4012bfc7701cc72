"""Cubes of given modes and numbers, which no kernel has made."""

import numpy as np

from dimersweep.cubes.cube import blank, build
from dimersweep.cubes.grid import make_grid
from dimersweep.kernel.model.layout import CODES, M_DRIFT, OUT


def built(grid, modes, **columns):
    """The cube of a grid with these modes, and columns by their names."""
    out, codes = blank(grid.size)
    codes[:, CODES.index("mode")] = np.ravel(modes)
    for name, values in columns.items():
        if name in CODES:
            codes[:, CODES.index(name)] = np.ravel(values)
        else:
            out[:, OUT.index(name)] = np.ravel(values)
    return build(grid, out, codes, {})


def cube_of(modes, axes, fixed=None, **columns):
    """The cube over axes with these modes."""
    return built(make_grid(axes, fixed or {}), modes, **columns)


def radii(values, modes=None, **axes):
    """The cube over axes of drifts with these radii, or of other modes."""
    return cube_of(np.full(np.size(values), M_DRIFT) if modes is None else modes, axes, radius=values)

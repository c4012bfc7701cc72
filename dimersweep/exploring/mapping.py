"""Prepare the map of a cube for a page: its variables, the cells of the part that is shown, and the run of a cell."""

from functools import partial
from math import prod
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.colors import to_hex

from dimersweep.cubes.cube import check_codes, names
from dimersweep.cubes.findings import edges_of, is_geometric
from dimersweep.errors import ParameterError
from dimersweep.extensions import MAPS, load
from dimersweep.kernel.model.layout import MODES
from dimersweep.parameters import completed
from dimersweep.plots.style import MODE_COLORS, MODE_LABELS, fixed_of, label, with_units
from dimersweep.plots.view import as_shown
from dimersweep.runs.point_source import parameters_of, source_of
from dimersweep.runs.run import Run
from dimersweep.symbols import is_angle, units_shown

MOST_CELLS = 250_000  # of one map, 500 x 500: more would make the page slow
# colours of a variable from its least value to its greatest
SHADES = np.array([to_hex(color) for color in colormaps["viridis"](np.linspace(0, 1, 256))])
label_of = partial(label, tex=False)


def axes_of(cube: xr.Dataset) -> list[str]:
    """Return the parameters that a map may have along its sides; raise a ParameterError if there are none.

    These are the axes of a grid with more than one value, or the parameters that vary from point to point.
    """
    if not isinstance(cube, xr.Dataset) or "mode" not in cube:
        table = f"a table along {', '.join(map(str, cube.sizes))}" if isinstance(cube, xr.Dataset) else ""
        known = table or type(cube).__name__
        raise ParameterError(f"explore: {known} is no cube; give one of sweep, or of open_cube(path)")
    mode = cube["mode"]
    check_codes(mode)
    points = "point" in mode.dims
    # direction is left out, since it has a slider
    wide = [str(name) for name in mode.dims if mode.sizes[name] > 1 and name != "direction"]
    axes = fixed_of(cube)[1] if points else wide
    if not axes or not mode.size:
        raise ParameterError("explore: needs a cube over at least one axis of more than one value")
    if prod([mode.sizes["point"]] if points else [mode.sizes[name] for name in axes[-2:]]) > MOST_CELLS:
        raise ParameterError(f"explore: a map of more than {MOST_CELLS} cells; give a part of the cube")
    return axes


class CubeMap:
    """The map of a cube, in parts that a page asks for.

    A `ParameterError` refuses a cube without a map, and a request for a part or a variable that does not exist.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        self.axes, self.cube, self.mode = axes_of(cube), cube, cube["mode"]
        self.dims = [str(name) for name in self.mode.dims]
        self.points = "point" in self.dims
        self.fixed = [name for name in self.dims if name not in (*self.axes[-2:], "point")]
        columns = {str(name): each for name, each in cube.data_vars.items() if each.dims == self.mode.dims}
        self.shown = ["mode", *(name for name, each in columns.items() if each.dtype.kind == "f")]
        self.colors, self.labels = [*MODE_COLORS.values()], [MODE_LABELS[word] for word in MODES]

    def description(self) -> dict[str, Any]:
        """Return the description of the map for a page: its axes, the values of the other axes, and its variables."""
        values = {name: self.cube[name] for name in self.fixed}
        words = {
            name: names(each).values.tolist()
            if name == "direction"
            else [as_shown(name, value) for value in each.values]
            for name, each in values.items()
        }
        return {
            "title": str(self.cube.attrs.get("title", "cube of dimersweep")),
            "dims": self.dims,
            "points": self.points,
            "sides": {name: label_of(name) for name in reversed(self.axes)} if self.points else {},
            "fixed": {name: {"label": label_of(name), "values": each} for name, each in words.items()},
            "shown": self.shown,
        }

    def part(self, asked: dict[str, str]) -> dict[str, Any]:
        """Return the cells of a part of the map: their places, modes, values and colours (hex).

        `asked` has the place along each of the `fixed` axes, the variable `shown`, and for single points the parameters
        `right` and `up`.
        """
        shown = one_of("shown", asked.get("shown", "mode"), self.shown)
        fixed = {name: place_of(name, asked.get(name, "0"), self.mode.sizes[name]) for name in self.fixed}
        x, y = self.axes[-1], self.axes[-2] if len(self.axes) > 1 else ""
        if self.points and y:
            x, y = (one_of(side, asked.get(side, name), self.axes) for side, name in (("right", x), ("up", y)))
        dims = ["point"] if self.points else [name for name in (y, x) if name]
        part = self.cube.isel(fixed).transpose(*dims, ...)
        values, modes = part[shown].values.ravel(), names(part["mode"]).values.ravel().tolist()
        data: dict[str, Any] = {"modes": modes, "dims": dims}
        for side, name in (("x", x), ("y", y)):
            along = self.cube[name].values if name else np.array([0.5])
            along = np.rad2deg(along) if is_angle(name) else along
            data[side] = {"name": name, "label": name and label_of(name), "at": along.tolist()}
            data[side]["log"] = bool(name) and not self.points and is_geometric(along)
            data[side]["edges"] = [along.min(), along.max()] if self.points else edges_of(along).tolist()
        data["held"] = self._shared(part, dims)
        if shown == "mode":
            data["key"] = [[self.colors[code], self.labels[code]] for code in np.unique(self.mode.values)]
            data["colors"] = np.array(self.colors)[values].tolist()
            return data
        whole = self.cube[shown].values
        finite = whole[np.isfinite(whole)]
        low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
        # the scale is that of the whole cube, so that colours mean the same in each part
        share = (values - low) / ((high - low) or 1.0)
        data["colors"] = np.where(
            np.isfinite(share), SHADES[np.nan_to_num(255 * np.clip(share, 0, 1)).astype(int)], ""
        ).tolist()
        data["values"] = [f"{value:.6g}" if np.isfinite(value) else "none" for value in values]
        units = units_shown(self.cube[shown].attrs.get("units", "1"))
        data["bar"] = {"ends": [f"{low:.4g}", f"{high:.4g}"], "label": with_units(shown.replace("_", " "), units)}
        data["bar"]["shades"] = SHADES[::51].tolist()  # 255 / 51: six shades from end to end
        return data

    def parameters_at(self, point: xr.Dataset) -> dict[str, float]:
        """Return the parameters of the run behind a point."""
        return parameters_of(point)

    def _shared(self, part: xr.Dataset, dims: list[str]) -> dict[str, str]:
        """Return the parameters that all points of a part share, as texts: only runs with these lie on the map."""
        # points at opposite ends of all axes differ in every parameter that varies along an axis
        places = {0, -1}
        if self.points:
            places = {int(end(part[name].values)) for name in self.axes for end in (np.argmin, np.argmax)}
        ends = [completed(self.parameters_at(part.isel(dict.fromkeys(dims, place)))) for place in places]
        return {
            name: as_shown(name, value) for name, value in ends[0].items() if all(end[name] == value for end in ends)
        }

    def run(self, at: str) -> tuple[Run, dict[str, Any]]:
        """Return the run behind a point, and the settings to repeat it.

        `at` has its places along the dimensions of the cube, separated by commas.
        """
        places = at.split(",")
        if len(places) != len(self.dims):
            raise ParameterError(f"at = {at}: must have a place along each of {', '.join(self.dims)}")
        where = {name: place_of(name, at, self.mode.sizes[name]) for name, at in zip(self.dims, places, strict=True)}
        point = self.cube.isel(where)
        run, how = point.dimersweep.run(), source_of(point).how
        periods = max(how.periods, run.n_periods)
        return run, {"periods": periods, "rtol": how.rtol, "stop_when_settled": how.stop_when_settled}


def map_of(data: xr.Dataset) -> CubeMap:
    """Return the map of a cube, or of a table of borders or branches."""
    for mark, place in MAPS.items():
        if isinstance(data, xr.Dataset) and mark in data:
            map_: CubeMap = load(place, "explore")(data)
            return map_
    return CubeMap(data)


def one_of(name: str, word: str, words: list[str]) -> str:
    """Return `word` if it is one of `words`, else raise a ParameterError."""
    if word not in words:
        raise ParameterError(f"{name} = {word}: must be one of {', '.join(words)}")
    return word


def place_of(name: str, text: str, n: int) -> int:
    """Return the index in `text`; raise a ParameterError if it is none of 0 to n - 1."""
    if not (text.isdecimal() and int(text) < n):
        raise ParameterError(f"{name} = {text}: must be a place from 0 to {n - 1}")
    return int(text)

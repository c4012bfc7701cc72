"""The board: a map of a cube, sliders, and the live run behind the point that is clicked, for a browser or a notebook."""

from html import escape
from typing import Any

import numpy as np
import panel as pn
import xarray as xr
from bokeh.events import Tap
from bokeh.models import ColorBar, ColumnDataSource, HoverTool, LinearColorMapper
from bokeh.plotting import figure

from dimersweep.cubes.cube import check_codes, names
from dimersweep.cubes.reading import edges_of, is_geometric
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import MODES
from dimersweep.plots import run_figure
from dimersweep.plots.style import MODE_COLORS, MODE_LABELS
from dimersweep.plots.tables import run_table, title_as_html
from dimersweep.runs import accessor  # noqa: F401 - the run behind a point
from dimersweep.runs.run import Run
from dimersweep.symbols import symbol, units_of

SHOWN_PERIODS = 60  # in the picture beside the map, if the run of the cube is shorter
MOST_CELLS = 250_000  # of one map: more would make the page slow


def label_of(name: str) -> str:
    """An axis and its unit, in plain letters."""
    units = units_of(name)
    return symbol(name) + (f" [{units}]" if units else "")


def told_apart(values: np.ndarray) -> list[str]:
    """Values in as many digits, five or more, as they need to differ."""
    for digits in range(5, 18):
        shown = [f"{value:.{digits}g}" for value in values]
        if len(set(shown)) == len(shown):
            break
    return shown


def _shown(run: Run) -> Run:
    """The run, or where it is short the same for longer: what a picture shows."""
    return run.go_on(SHOWN_PERIODS - run.n_periods) if run.n_periods < SHOWN_PERIODS else run


class Board:
    """The parts of the board, and what a click does.

    Parameters
    ----------
    cube : xarray.Dataset
        With one axis of the model or more.

    Raises
    ------
    ParameterError
        If it is no cube, has no such axis, or a map has too many cells.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        if not isinstance(cube, xr.Dataset) or "mode" not in cube:
            raise ParameterError(f"explore: {type(cube).__name__} is no cube; give one of sweep, or of open_cube(path)")
        self.cube = cube
        mode = cube["mode"]
        check_codes(mode)
        axes = [str(name) for name in mode.dims if mode.sizes[name] > 1]
        if not axes or "point" in axes or not mode.size:
            raise ParameterError("explore: needs a cube over at least one axis of more than one value")
        self.x, self.y = axes[-1], axes[-2] if len(axes) > 1 else ""
        if mode.sizes[self.x] * (mode.sizes[self.y] if self.y else 1) > MOST_CELLS:
            raise ParameterError(f"explore: a map of more than {MOST_CELLS} cells; give a part of the cube")
        self.fixed = {str(name): 0 for name in mode.dims if name not in (self.x, self.y)}
        self.source, self.spot = ColumnDataSource(), ColumnDataSource({"x": [], "y": []})
        numbers = [
            str(name) for name, each in cube.data_vars.items() if each.dims == mode.dims and each.dtype.kind == "f"
        ]
        self.quantity = pn.widgets.Select(label="shown", options=["mode", *numbers], value="mode")
        self.sliders = {name: self._slider(name) for name in self.fixed if mode.sizes[name] > 1}
        self.mapper = LinearColorMapper(palette="Viridis256", nan_color="#ffffff")
        self.map = self._map()
        self.told = pn.pane.HTML("Click a point of the map: its run appears here.", sizing_mode="stretch_width")
        self.picture = pn.pane.Matplotlib(None, tight=False, format="svg", sizing_mode="stretch_width")
        self._recolor()
        self.quantity.param.watch(self._moved, "value")

    def _slider(self, name: str) -> Any:
        options = {value: k for k, value in enumerate(told_apart(self.cube[name].values))}
        slider = pn.widgets.DiscreteSlider(label=label_of(name), options=options)
        slider.param.watch(self._moved, "value")
        return slider

    def _moved(self, event: Any) -> None:
        for name, slider in self.sliders.items():
            self.fixed[name] = slider.value
        self._recolor()

    def _map(self) -> Any:
        kinds = {"x_axis_type": "log" if is_geometric(self.cube[self.x].values) else "linear"}
        if self.y:
            kinds["y_axis_type"] = "log" if is_geometric(self.cube[self.y].values) else "linear"
        plot = figure(width=560, height=430 if self.y else 180, tools="pan,wheel_zoom,box_zoom,reset", **kinds)
        x, y = edges_of(self.cube[self.x].values), self._y_edges()
        self.lower = np.meshgrid(x[:-1], y[:-1])
        self.upper = np.meshgrid(x[1:], y[1:])
        plot.quad("left", "right", "bottom", "top", source=self.source, fill_color="color", line_color=None)
        plot.scatter(
            "x", "y", source=self.spot, size=14, marker="circle_x", fill_color=None, line_color="black", line_width=2
        )
        plot.add_tools(
            HoverTool(tooltips=[(self.x, "@x"), (self.y or "mode", "@y" if self.y else "@mode"), ("mode", "@mode")])
        )
        plot.xaxis.axis_label = label_of(self.x)
        plot.yaxis.axis_label = label_of(self.y) if self.y else ""
        plot.yaxis.visible = bool(self.y)
        plot.x_range.range_padding = plot.y_range.range_padding = 0
        self.bar = ColorBar(color_mapper=self.mapper, visible=False)
        plot.add_layout(self.bar, "right")
        plot.on_event(Tap, lambda event: self.click(event.x, event.y))
        return plot

    def _y_edges(self) -> np.ndarray:
        return edges_of(self.cube[self.y].values) if self.y else np.array([0.0, 1.0])

    def _recolor(self) -> None:
        """Fill the cells of the map for the present place of the sliders."""
        part = self.cube.isel(self.fixed).transpose(*([self.y] if self.y else []), self.x, ...)
        modes, shown = part["mode"].values.ravel(), self.quantity.value
        if shown == "mode":
            colors = np.array(list(MODE_COLORS.values()))[modes]
        else:
            colors = self._shades(self.cube[shown].values, part[shown].values.ravel())
        self.bar.visible = shown != "mode"
        y = self.cube[self.y].values if self.y else np.array([0.5])
        xs, ys = np.meshgrid(self.cube[self.x].values, y)
        (left, bottom), (right, top) = self.lower, self.upper
        self.source.data = {
            name: values.ravel()
            for name, values in {
                "left": left,
                "right": right,
                "bottom": bottom,
                "top": top,
                "x": xs,
                "y": ys,
                "color": colors,
                "mode": names(part["mode"]).values,
            }.items()
        }

    def _shades(self, whole: np.ndarray, values: np.ndarray) -> np.ndarray:
        finite = whole[np.isfinite(whole)]
        low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
        self.mapper.low, self.mapper.high = float(low), float(high)
        palette = np.array([*self.mapper.palette, self.mapper.nan_color])
        place = np.clip(np.nan_to_num((values - low) / ((high - low) or 1.0)) * 255, 0, 255).astype(int)
        return palette[np.where(np.isfinite(values), place, 256)]

    def click(self, x: float, y: float) -> Run | None:
        """Show the run behind the point of the map that is nearest to `x` and `y`; None where there is none."""
        where: dict[str, Any] = {self.x: x} | ({self.y: y} if self.y else {})
        point = self.cube.isel(self.fixed).sel(where, method="nearest")
        at = float(point[self.x]), float(point[self.y]) if self.y else 0.5
        self.spot.data = {"x": [at[0]], "y": [at[1]]}
        try:
            run: Run = point.dimersweep.run()
        except ParameterError as error:
            self.told.object = f"No run here: {escape(str(error))}"
            return None
        self.told.object = run_table(run)
        self.picture.object = run_figure(_shown(run)) if run.status == "ok" else None
        return run

    def legend(self) -> str:
        """The colours of the modes that occur, as HTML."""
        present = np.unique(self.cube["mode"].values)
        mark = "display:inline-block;width:0.9em;height:0.9em;border:1px solid #333;margin:0 0.3em 0 0.9em;background:"
        return "".join(
            f'<span style="{mark}{MODE_COLORS[MODES[code]]}"></span>{MODE_LABELS[MODES[code]]}' for code in present
        )

    def layout(self) -> Any:
        """All of it, for `panel` to serve or a notebook to show."""
        left = pn.Column(self.quantity, *self.sliders.values(), pn.pane.Bokeh(self.map), pn.pane.HTML(self.legend()))
        right = pn.Column(self.told, self.picture, sizing_mode="stretch_width")
        heading = pn.pane.HTML(f"<h3>{title_as_html(self.cube)}</h3>")
        return pn.Column(heading, pn.Row(left, right, sizing_mode="stretch_width"), sizing_mode="stretch_width")


def layout_of(cube: xr.Dataset) -> Any:
    """The board of `cube`, one for each visitor of a page."""
    pn.extension()
    return Board(cube).layout()

"""The board: a map of a cube, sliders, and the live run behind the point that is clicked, for a browser or a notebook."""

from functools import partial
from html import escape
from math import prod
from typing import Any

import numpy as np
import panel as pn
import xarray as xr
from bokeh.events import Tap
from bokeh.models import ColorBar, ColumnDataSource, HoverTool, LinearColorMapper
from bokeh.plotting import figure
from bokeh.transform import transform

from dimersweep.cubes.cube import check_codes, names
from dimersweep.cubes.findings import edges_of, is_geometric
from dimersweep.errors import ParameterError, StoreError
from dimersweep.kernel.model.layout import MODES
from dimersweep.plots import run_figure
from dimersweep.plots.playback import playback_of
from dimersweep.plots.replay import replay_page
from dimersweep.plots.style import MODE_COLORS, MODE_LABELS, fixed_of, label, with_units
from dimersweep.plots.tables import run_table, title_as_html
from dimersweep.runs import accessor  # noqa: F401 - the run behind a point
from dimersweep.runs.run import Run
from dimersweep.symbols import is_angle, units_shown

SHOWN_PERIODS = 60  # in the picture beside the map, if the run of the cube is shorter
REPLAYED = 6  # forcing periods
MOST_CELLS = 250_000  # of one map: more would make the page slow
label_of = partial(label, tex=False)


def shown_as(name: str, values: np.ndarray) -> np.ndarray:
    """Values of a parameter in the unit that it is shown in: degrees for an angle."""
    return np.rad2deg(values) if is_angle(name) else values


def distinct_labels(values: np.ndarray) -> list[str]:
    """Values in as many digits, five or more, as they need to differ."""
    for digits in range(5, 18):
        shown = [f"{value:.{digits}g}" for value in values]
        if len(set(shown)) == len(shown):
            break
    return shown


def axes_of(cube: xr.Dataset) -> list[str]:
    """The parameters that a map of a cube may have along its sides: its axes, or what varies from point to point.

    Raises
    ------
    ParameterError
        If it is no cube, has no such axis, or a map has too many cells.
    """
    if not isinstance(cube, xr.Dataset) or "mode" not in cube:
        raise ParameterError(f"explore: {type(cube).__name__} is no cube; give one of sweep, or of open_cube(path)")
    mode = cube["mode"]
    check_codes(mode)
    points = "point" in mode.dims
    wide = [str(name) for name in mode.dims if mode.sizes[name] > 1 and name != "direction"]  # that has a slider
    axes = fixed_of(cube)[1] if points else wide
    if not axes or not mode.size:
        raise ParameterError("explore: needs a cube over at least one axis of more than one value")
    shown = [mode.sizes["point"]] if points else [mode.sizes[name] for name in axes[-2:]]
    if prod(shown) > MOST_CELLS:
        raise ParameterError(f"explore: a map of more than {MOST_CELLS} cells; give a part of the cube")
    return axes


class Board:
    """The parts of the board, and what a click does.

    Parameters
    ----------
    cube : xarray.Dataset
        With one axis of the model or more, or of points of which one parameter or more varies.

    Raises
    ------
    ParameterError
        If it is no cube, has no such axis, or a map has too many cells.
    """

    def __init__(self, cube: xr.Dataset) -> None:
        axes = axes_of(cube)
        self.cube, mode = cube, cube["mode"]
        self.points = "point" in mode.dims
        self.x, self.y = axes[-1], axes[-2] if len(axes) > 1 else ""
        self.fixed = {str(name): 0 for name in mode.dims if name not in (self.x, self.y, "point")}
        self.source, self.spot = ColumnDataSource(), ColumnDataSource({"x": [], "y": []})
        columns = {str(name): each for name, each in cube.data_vars.items() if each.dims == mode.dims}
        numbers = [name for name, each in columns.items() if each.dtype.kind == "f"]
        self.quantity = pn.widgets.Select(label="shown", options=["mode", *numbers], value="mode")
        self.sliders = {name: self._slider(name) for name in self.fixed if mode.sizes[name] > 1}
        options = {label_of(name): name for name in axes}
        chosen = {"right": self.x, "up": self.y} if self.points and self.y else {}
        self.choices = {way: pn.widgets.Select(label=way, options=options, value=name) for way, name in chosen.items()}
        self.mapper = LinearColorMapper(palette="Viridis256", nan_color="#ffffff")
        self.key = pn.pane.HTML(self.legend())
        self.hover = HoverTool(formatters=dict.fromkeys(("@x", "@y", "@shown"), "printf"))
        self.map = self._map()
        self.summary = pn.pane.HTML("Click a point of the map: its run appears here.", sizing_mode="stretch_width")
        self.picture = pn.pane.Matplotlib(None, tight=False, format="svg", sizing_mode="stretch_width")
        self.run: Run | None = None
        self.replay = pn.widgets.Button(label="replay", visible=False)
        self.motion = pn.pane.HTML("", sizing_mode="stretch_width")
        self.replay.on_click(self._replay)
        self._recolor()
        for widget in (self.quantity, *self.choices.values()):
            widget.param.watch(self._moved, "value")

    def _slider(self, name: str) -> Any:
        values = self.cube[name].values
        carried = name == "direction"
        words = names(self.cube[name]).values.tolist() if carried else distinct_labels(shown_as(name, values))
        options = {value: k for k, value in enumerate(words)}
        slider = pn.widgets.DiscreteSlider(label=label_of(name), options=options)
        slider.param.watch(self._moved, "value")
        return slider

    def _moved(self, event: Any) -> None:
        for name, slider in self.sliders.items():
            self.fixed[name] = slider.value
        if self.choices:
            self.x, self.y = self.choices["right"].value, self.choices["up"].value
            self.spot.data = {"x": [], "y": []}  # the point that was clicked is another one now
        self._recolor()

    def _map(self) -> Any:
        geometric = [name for name in (self.x, self.y) if name and not self.points and is_geometric(self._along(name))]
        kinds = {f"{way}_axis_type": "log" for way, name in (("x", self.x), ("y", self.y)) if name in geometric}
        height = 430 if self.y else 180
        plot = figure(height=height, sizing_mode="stretch_width", tools="pan,wheel_zoom,box_zoom,reset", **kinds)
        if self.points:
            cells = plot.scatter("x", "y", source=self.source, size=8, fill_color="color", line_color="#999999")
        else:
            cells = plot.quad("left", "right", "bottom", "top", source=self.source, fill_color="color", line_color=None)
            plot.x_range.range_padding = plot.y_range.range_padding = 0
        plot.scatter(
            "x", "y", source=self.spot, size=14, marker="circle_x", fill_color=None, line_color="black", line_width=2
        )
        self.hover.renderers = [cells]  # the mark of a click has nothing to show
        plot.add_tools(self.hover)
        plot.yaxis.visible = bool(self.y)
        self.bar = ColorBar(color_mapper=self.mapper, visible=False)
        plot.add_layout(self.bar, "right")
        plot.on_event(Tap, lambda event: self.click(event.x, event.y))
        return plot

    def _along(self, name: str) -> np.ndarray:
        """Values of a parameter of the map as shown, of each point where they are no grid; one for no parameter."""
        return shown_as(name, self.cube[name].values) if name else np.array([0.5])

    def _cells(self) -> dict[str, np.ndarray]:
        """Where the points of the map lie, and the edges of their cells."""
        x, y = self._along(self.x), self._along(self.y)
        if self.points:
            return {"x": x, "y": y if self.y else np.full(x.size, y[0])}
        right, up = edges_of(x), edges_of(y)
        (left, bottom), (right, top) = np.meshgrid(right[:-1], up[:-1]), np.meshgrid(right[1:], up[1:])
        xs, ys = np.meshgrid(x, y)
        return {"left": left, "right": right, "bottom": bottom, "top": top, "x": xs, "y": ys}

    def _part(self) -> xr.Dataset:
        """The part of the cube that is shown, in the order of its cells."""
        dims = ["point"] if self.points else [name for name in (self.y, self.x) if name]
        return self.cube.isel(self.fixed).transpose(*dims, ...)

    def _recolor(self) -> None:
        """Fill the map for the present place of the sliders, and say what its colours are."""
        part, shown = self._part(), self.quantity.value
        tooltips = {label_of(self.x): "@x{%.5g}"} | ({label_of(self.y): "@y{%.5g}"} if self.y else {})
        tooltips["mode"] = "@mode"
        columns = {name: values.ravel() for name, values in self._cells().items()}
        columns["mode"] = names(part["mode"]).values.ravel()
        columns["color"] = np.array(list(MODE_COLORS.values()))[part["mode"].values.ravel()]
        columns["shown"], fill = part[shown].values.ravel(), "color"
        if shown != "mode":
            whole = self.cube[shown].values
            finite = whole[np.isfinite(whole)]
            low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
            self.mapper.low, self.mapper.high = low, high if high > low else low + 1
            fill = transform("shown", self.mapper)
            units = units_shown(self.cube[shown].attrs.get("units", "1"))
            self.bar.title = with_units(shown.replace("_", " "), units)
            tooltips[self.bar.title] = "@shown{%.6g}"
        self.bar.visible, self.key.visible = shown != "mode", shown == "mode"
        self.hover.tooltips = list(tooltips.items())
        self.map.xaxis.axis_label, self.map.yaxis.axis_label = label_of(self.x), self.y and label_of(self.y)
        self.source.data = columns
        self.hover.renderers[0].glyph.fill_color = fill

    def click(self, x: float, y: float) -> Run | None:
        """Show the run behind the point of the map that is nearest to `x` and `y`; None where there is none.

        Parameters
        ----------
        x, y : float
            A place on the map, in the units of its axes.
        """
        part, cells = self._part(), self.source.data
        # in the eye of who looks at the map
        away = sum(((cells[way] - at) / (np.ptp(cells[way]) or 1.0)) ** 2 for way, at in (("x", x), ("y", y)))
        near = int(np.argmin(away))
        place = np.unravel_index(near, part["mode"].shape)
        point = part.isel(dict(zip(part["mode"].dims, place, strict=True)))
        self.spot.data = {way: [float(cells[way][near])] for way in "xy"}
        self.motion.object, self.replay.visible = "", False
        try:
            run: Run = point.dimersweep.run()
        except ParameterError as error:
            self.summary.object = f"No run here: {escape(str(error))}"
            self.picture.object = None
            return None
        self.summary.object, self.picture.object = run_table(run), None
        if run.status == "ok":
            short = SHOWN_PERIODS - run.n_periods
            self.run, self.replay.visible = run.go_on(short) if short > 0 else run, True
            self.picture.object = run_figure(self.run)
        return run

    def _replay(self, event: Any) -> None:
        """Show the end of the run that was clicked in three dimensions."""
        assert self.run is not None
        try:
            page = replay_page(self.run, playback_of(self.run, REPLAYED))
        except StoreError as error:
            self.motion.object = escape(str(error))
            return
        look = "width: 100%; height: 640px; border: 0"
        self.motion.object = f'<iframe title="replay" style="{look}" srcdoc="{escape(page)}"></iframe>'

    def legend(self) -> str:
        """The colours of the modes that occur, as HTML."""
        present = np.unique(self.cube["mode"].values)
        mark = "display:inline-block;width:0.9em;height:0.9em;border:1px solid #333;margin:0 0.3em 0 0.9em;background:"
        words = [MODES[code] for code in present]
        return "".join(f'<span style="{mark}{MODE_COLORS[word]}"></span>{MODE_LABELS[word]}' for word in words)

    def layout(self) -> Any:
        """All of it, for `panel` to serve or a notebook to show."""
        widgets = (self.quantity, *self.choices.values(), *self.sliders.values())
        shown = (pn.pane.Bokeh(self.map, sizing_mode="stretch_width"), self.key)
        # side by side where there is room for both, else below one another
        left = pn.Column(*widgets, *shown, sizing_mode="stretch_width", max_width=600, styles={"flex": "1 1 340px"})
        run = (self.summary, self.picture, self.replay, self.motion)
        right = pn.Column(*run, sizing_mode="stretch_width", styles={"flex": "1 1 340px"})
        heading = pn.pane.HTML(f"<h3>{title_as_html(self.cube)}</h3>")
        return pn.Column(heading, pn.FlexBox(left, right, sizing_mode="stretch_width"), sizing_mode="stretch_width")


def layout_of(cube: xr.Dataset) -> Any:
    """The board of `cube`, one for each visitor of a page."""
    pn.extension()
    return Board(cube).layout()

"""Share colours, figures, labels of parameters and files of pictures among all pictures."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import xarray as xr
from matplotlib import colormaps, rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure, FigureBase
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator

from dimersweep import symbols
from dimersweep.cubes.grid import DIRECTIONS
from dimersweep.errors import ParameterError
from dimersweep.parameters import reduced
from dimersweep.storage.files import disk_errors, replacing
from dimersweep.storage.outputs import check_output
from dimersweep.symbols import PARAMETERS, QUANTITIES, conditions, is_angle, symbol, units_of, units_shown

# after Okabe and Ito: any two are at least 20 apart in CIELAB, also as seen with deuteranopia or protanopia
MODE_COLORS = {
    "not_run": "#ffffff",
    "failed": "#000000",
    "rest": "#999999",
    "drift": "#0072b2",
    "jump": "#e69f00",
    "flutter": "#139059",
    "period_n": "#964777",
    "aperiodic": "#ce5802",
    "unresolved": "#c8b99a",
    "rolls": "#56b4e9",
    "slides": "#6a053a",
}
MODE_LABELS = {word: word for word in MODE_COLORS} | {
    "rest": "rest: both ends down",  # not "at rest": it may roll on
    "rolls": "rolls: both ends down, speed changes",
    "slides": "slides: both ends down, slipping",
}
ROW_COLORS = ("#1f4fd8", "#d62728", "#000000", "#009e73", "#dd99cc", "#e69f00")  # the first three are the paper's
DIRECTION_WORDS = tuple(f"going {word}" for word in DIRECTIONS)  # words for the directions in which a state was carried
DIRECTION_MARKERS = (">", "<")
PICTURES = (".png", ".pdf", ".svg")
DPI = 200  # resolution of a PNG, and of images in other files [dots per inch]
# TrueType fonts, which journals take; in SVG text stays text
FONTS: Any = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none"}
# width [inches] below which a figure is as narrow as a column of a paper: panels and legend stand one below the other
COLUMN = 4.5
CLOSE_PANELS = 1e3  # span of a logarithmic scale beyond which ticks at 2 and 5, too, would be too many
INDISTINCT = 1e-12  # relative difference of values, absolute below 1, that is round-off: such values are drawn as one


class Look(TypedDict, total=False):
    """Options of every picture besides its data: where it is drawn, its size and its title.

    Attributes
    ----------
    ax : matplotlib Axes, Figure or SubFigure
        Where to draw: an Axes for a picture of one panel, an empty Figure or SubFigure for any; by default a new
        figure. An Axes has no heading but `title`, and its legend stands to its right.
    size : tuple of float
        Width and height of a new figure [inches].
    title : str
        The heading, in place of the parameters; "" for none.

    Examples
    --------
    >>> from dimersweep import plots, sweep
    >>> cube = sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.28, 0.36]}, periods=60, progress=False)
    >>> plots.mode_map(cube, size=(5, 3), title="Modes").savefig("modes.pdf")
    """

    ax: Axes | FigureBase | None
    size: tuple[float, float] | None
    title: str | None


class Drawing(Figure):
    """Figure with its own layout, and with one size in pixels and one kind of fonts whoever saves it."""

    def __init__(self, width: float, height: float) -> None:
        super().__init__(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.08))

    def savefig(self, fname: Any, **how: Any) -> None:
        """Save the figure as matplotlib does, with `DPI` unless another resolution is given."""
        with rc_context(FONTS):
            super().savefig(fname, **{"dpi": DPI} | how)


@dataclass(frozen=True)
class Board:
    """Place where a picture is drawn: its figure, and the Axes that a user gave, if any, with its title."""

    figure: Any
    given: Any = None
    title: str = ""

    @property
    def axes(self) -> list[Axes]:
        """All panels of the figure, or the Axes that was given."""
        return [self.given] if self.given else self.figure.axes

    def legend(self, where: str, handles: Sequence[Any], **how: Any) -> None:
        """Draw a legend outside of the panels, where it hides nothing."""
        if handles and self.given is None:
            most = how.pop("ncols", 1)
            if narrow(self.figure):
                where, most = "lower center", min(4, len(handles))
            for columns in range(most, 0, -1):  # as many columns as there is room for
                legend = self.figure.legend(handles=handles, loc=f"outside {where}", ncols=columns, **how)
                if columns == 1 or legend.get_window_extent().width <= self.figure.bbox.width:
                    return
                legend.remove()
        elif handles:
            right = {"loc": "upper left", "bbox_to_anchor": (1.02, 1.0), "borderaxespad": 0, "ncols": 1}
            self.given.legend(handles=handles, **how | right)

    def done(self, above: float = 6.0) -> Figure:
        """Finish the picture and return its figure; a title stands `above` a given Axes by that distance [pt]."""
        for axes in self.axes:
            beyond_round_off(axes)
        if self.title:
            self.given.set_title(self.title, fontsize="medium", pad=above)
        return self.figure


def board(look: Look, size: tuple[float, float], heading: str = "", **panels: Any) -> tuple[Board, Any]:
    """Return a board with a heading, and its panels as `Figure.subplots` or `Figure.subplot_mosaic` makes them.

    They are in a new figure of `size` [inches], or in the place that `look` gives.
    """
    if left := look.keys() - Look.__optional_keys__:
        raise TypeError(f"{min(left)}: unknown option (allowed: {', '.join(Look.__annotations__)})")
    ax, wanted, title = look.get("ax"), look.get("size"), look.get("title")
    mosaic = panels.pop("mosaic", None)
    n = len({*np.ravel(mosaic)}) if mosaic else panels.get("nrows", 1) * panels.get("ncols", 1)
    if ax is not None and wanted is not None:
        raise ParameterError(f"size = {wanted}: is that of ax; leave one of the two out")
    if isinstance(ax, Axes):
        if n > 1:
            raise ParameterError(f"ax: is one Axes for a picture of {n} panels; give a Figure or SubFigure")
        return Board(ax.figure, ax, title or ""), ax if panels.get("squeeze", True) else np.array([[ax]])
    if not isinstance(ax, FigureBase | None):
        raise ParameterError(f"ax: is a {type(ax).__name__}; give an Axes, a Figure or a SubFigure")
    figure = Drawing(*(wanted or size)) if ax is None else ax
    entitle(figure, heading if title is None else title)
    # panels that share axes by row or column stay a matrix in a narrow figure, too
    if not narrow(figure) or {panels.get("sharex"), panels.get("sharey")} & {"col", "row"}:
        return Board(figure), figure.subplot_mosaic(mosaic) if mosaic else figure.subplots(**panels)
    if mosaic:
        return Board(figure), figure.subplot_mosaic([[each] for each in dict.fromkeys(np.concatenate(mosaic).tolist())])
    as_usual = np.empty((panels.pop("nrows", 1), panels.pop("ncols", 1)), object)
    squeezed = panels.pop("squeeze", True)
    as_usual[:] = figure.subplots(nrows=n, squeeze=False, **panels).reshape(as_usual.shape)
    return Board(figure), (as_usual if not squeezed else as_usual.squeeze() if n > 1 else as_usual[0, 0])


def narrow(figure: Any) -> bool:
    """Return True if a figure is as narrow as a column of a paper."""
    return bool(figure.bbox.width < COLUMN * figure.dpi)


def beyond_round_off(axes: Axes) -> None:
    """Widen linear axes on which only round-off would be seen."""
    for axis in (axes.xaxis, axes.yaxis):
        shown = tuple(axis.get_view_interval())
        if axis.get_scale() == "linear" and widened(*shown) != shown:
            axis.set_view_interval(*widened(*shown), ignore=True)


def widened(low: float, high: float) -> tuple[float, float]:
    """Return the ends of a scale, set apart by a tenth of their size if only round-off lies between them."""
    size = max(abs(low), abs(high))
    if abs(high - low) > INDISTINCT * max(1.0, size):
        return low, high
    half = 0.05 * (size if size > INDISTINCT else 1.0)
    return low - half, high + half


def ink() -> str:
    """Return the colour of lines that are black on a white ground, in the current style of matplotlib."""
    return to_hex(rcParams["text.color"])


def mode_colors() -> dict[str, str]:
    """Return the colour of each mode in the current style of matplotlib.

    On a dark ground black and white are exchanged.
    """
    dark = np.mean(to_rgb(rcParams["axes.facecolor"])) < 0.5
    return MODE_COLORS | ({"not_run": "#000000", "failed": "#ffffff"} if dark else {})


def row_colors(n: int) -> list[Any]:
    """Return `n` distinct colours for the curves in one panel."""
    if n <= len(ROW_COLORS):
        return [ink() if color == "#000000" else color for color in ROW_COLORS[:n]]
    return [colormaps["viridis"](k / (n - 1)) for k in range(n)]


def parameter_shown(name: str, value: float) -> str:
    """Return a parameter and its value, such as f = 15 Hz, with its symbol in TeX; or a direction in words."""
    return DIRECTION_WORDS[int(value)] if name == "direction" else symbols.parameter_shown(name, value, tex=True)


def with_units(text: str, units: str) -> str:
    """Return a text with its units in brackets, if there are any."""
    return f"{text} [{units}]" if units else text


def label(name: str, *, tex: bool = True, own: Mapping[str, Any] | None = None) -> str:
    """Return the label of an axis: the symbol of a parameter or the name of a quantity, with the unit that is shown.

    The variable of a user's observer is labelled by its long name, from its attributes `own`.
    """
    if name in PARAMETERS:
        return with_units(symbol(name, tex=tex), units_of(name))
    if own is not None and name not in QUANTITIES:
        return with_units(str(own.get("long_name", name)), units_shown(str(own.get("units", "1"))))
    text = name.replace("_", " ")
    return with_units(text.replace("zeta", r"$\zeta$") if tex else text, units_shown(QUANTITIES[name].units))


class _InDegrees:
    """Mixin for a locator of ticks: on an axis in radians its places are round numbers of degrees."""

    def tick_values(self, vmin: float, vmax: float) -> Any:
        return np.deg2rad(super().tick_values(np.rad2deg(vmin), np.rad2deg(vmax)))  # type: ignore[misc]


class _Degrees(_InDegrees, MaxNLocator): ...


class _LogDegrees(_InDegrees, LogLocator): ...


def mark(axis: Axis, name: str) -> None:
    """Label an axis with the symbol and unit of a parameter.

    An angle has ticks in degrees, while its values are in radians. The axis of the direction in which a state was
    carried has words as ticks.
    """
    if name == "direction":
        axis.set_ticks(range(len(DIRECTION_WORDS)), labels=DIRECTION_WORDS)
        return
    axis.set_label_text(label(name))
    if is_angle(name):
        linear = axis.get_scale() == "linear"
        axis.set_major_locator(
            _Degrees(nbins=7, steps=[1, 1.5, 2, 3, 6, 10]) if linear else _LogDegrees(subs=(1, 2, 5))
        )
        axis.set_major_formatter(lambda angle, _: f"{round(np.rad2deg(angle), 9):g}")
        axis.set_minor_locator(NullLocator())


def percent(share: float) -> str:
    """Return a share above 0 as a text such as 12.3 %."""
    return f"{100 * share:.1f} %" if share >= 5e-4 else "< 0.1 %"  # a smaller share would read 0.0 %


def log_scale(axes: Axes) -> None:
    """Make the y axis logarithmic, with plain numbers.

    They stand at 1, 2 and 5 of each decade, at 1 alone over more than three decades, and at even distances within one
    decade. Where nothing is drawn the axis stays as it is.
    """
    if not np.isfinite(axes.dataLim.minposy):
        return
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    places = (1, 2, 5) if high < CLOSE_PANELS * low else (1,)
    axes.yaxis.set_major_locator(LogLocator(subs=places) if high > 10 * low else MaxNLocator(6))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def fixed_of(cube: xr.Dataset) -> tuple[dict[str, float], list[str]]:
    """Return the parameters that have one value all over a cube, and the names of the others."""
    parameters = reduced({name: cube[name].variable for name in PARAMETERS if name in cube.coords and cube[name].size})
    columns = {name: values.values.ravel() for name, values in parameters.items()}
    varied = [name for name, values in columns.items() if (values != values[0]).any()]
    return {name: float(values[0]) for name, values in columns.items() if name not in varied}, varied


def title(cube: xr.Dataset) -> str:
    """Return the fixed parameters of a cube in words.

    They are the parameters in the paper's captions, and all others that differ from the base case.
    """
    return conditions(*fixed_of(cube), tex=True)


def entitle(figure: FigureBase, heading: str) -> Text:
    """Write a heading above all panels, in as many lines as the figure's width needs."""
    return figure.suptitle(heading, fontsize="medium", wrap=True)


def framed(
    look: Look, cube: xr.Dataset, size: tuple[float, float], heading: str = "", **panels: Any
) -> tuple[Board, Any]:
    """Return a board and its panels, see `board`; the heading ends with the fixed parameters of `cube`."""
    return board(look, size, heading + title(cube), **panels)


def face(color: Any, label: str, edgecolor: str = "", linewidth: float | None = 0.5, hatch: str = "") -> Patch:
    """Return the handle of a legend for areas of a colour."""
    return Patch(facecolor=color, edgecolor=edgecolor or ink(), linewidth=linewidth, hatch=hatch or None, label=label)


def spread(n: int, most: int) -> np.ndarray:
    """Return at most `most` of n places, evenly spread, the first and last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))


def check_picture(path: str | os.PathLike[str], *, force: bool = False, name: str = "out") -> Path:
    """Refuse a picture file that could not be written, before any work is done; return its path.

    Raises
    ------
    ParameterError
        If its ending is none of `PICTURES`.
    StoreError
        If the file could not be written.

    Examples
    --------
    >>> from dimersweep.plots import check_picture
    >>> check_picture("map.svg").suffix
    '.svg'
    """
    return check_output(path, force=force, name=name, what="a picture", endings=PICTURES)


def write_picture(figure: Figure, path: str | os.PathLike[str], *, force: bool = False, **how: Any) -> None:
    """Write `figure` to a file; other arguments go to `Figure.savefig`.

    Raises
    ------
    ParameterError, StoreError
        If `check_picture` refuses the file, or it cannot be written.

    Examples
    --------
    >>> from dimersweep.plots import run_figure, write_picture
    >>> from dimersweep import simulate
    >>> write_picture(run_figure(simulate(periods=30)), "run.png", force=True)
    """
    path = check_picture(path, force=force, name="picture")
    with disk_errors(f"picture = {path}", ""), replacing(path) as temporary, rc_context(FONTS):
        figure.savefig(temporary, format=path.suffix.removeprefix("."), **how)

"""What all pictures share: colors, labels of parameters, edges of cells, and which files a picture may go to."""

import os
from pathlib import Path
from typing import Any

import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from dimersweep.storage.files import replacing, told
from dimersweep.storage.netcdf import check_output
from dimersweep.symbols import PARAMETERS

# after Okabe and Ito: told apart by color-blind readers too
MODE_COLORS = {
    "not_run": "#ffffff",
    "failed": "#000000",
    "rest": "#999999",
    "drift": "#0072b2",
    "jump": "#e69f00",
    "flutter": "#009e73",
    "period_n": "#cc79a7",
    "aperiodic": "#d55e00",
    "unresolved": "#c4bba3",
}
MODE_LABELS = {word: word for word in MODE_COLORS} | {"rest": "rest: both ends down"}  # it may roll on
ROW_COLORS = ("#1f4fd8", "#d62728", "#000000", "#009e73", "#cc79a7", "#e69f00")  # the paper's three first
TEX = {
    "e": "e",
    "Gamma": r"\Gamma",
    "f": "f",
    "A_r": "A_r",
    "mu": r"\mu",
    "mu_s": r"\mu_s",
    "beta0": r"\beta(0)",
    "xdot0": r"\dot{x}_1(0)",
    "phi0": r"\phi_0",
    "r": "r",
    "rho_b": r"\rho_b",
    "rho_r": r"\rho_r",
    "D_r": "D_r",
    "g": "g",
    "e_1": "e_1",
    "e_2": "e_2",
    "Gamma_2": r"\Gamma_2",
    "phi_2": r"\phi_2",
    "mu_h": r"\mu_h",
}
PICTURES = (".png", ".pdf", ".svg")
DPI = 200  # of a picture that is not made of lines


def row_colors(n: int) -> list[Any]:
    """Colours of `n` curves in one panel, all of them distinct."""
    if n <= len(ROW_COLORS):
        return list(ROW_COLORS[:n])
    return [colormaps["viridis"](k / (n - 1)) for k in range(n)]


def units_of(name: str) -> str:
    """Unit of a parameter as it is shown, empty if it has none."""
    return units_shown(PARAMETERS[name].units)


def units_shown(units: str) -> str:
    """A unit as it is shown, such as rad/s of rad s-1."""
    return "" if units == "1" else units.replace(" s-1", "/s").replace(" s-2", "/s²").replace(" m-3", "/m³")


def given(name: str, value: float) -> str:
    """A parameter and its value, such as f = 15 Hz."""
    return f"${TEX[name]}$ = {value:.4g} {units_of(name)}".rstrip()


def label(name: str) -> str:
    """Axis label of a parameter: its symbol and unit."""
    units = units_of(name)
    return f"${TEX[name]}$" + (f" [{units}]" if units else "")


def percent(share: float) -> str:
    """A share that is not 0, such as 12.3 %."""
    return f"{100 * share:.1f} %" if share >= 5e-4 else "< 0.1 %"


def log_scale(axes: Axes) -> None:
    """A logarithmic y axis with plain numbers at 1, 2 and 5."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def title(cube: xr.Dataset) -> str:
    """The fixed parameters of the paper's captions, in one line."""
    shown = [name for name in ("xdot0", "A_r", "e", "Gamma", "f", "mu", "mu_s", "beta0") if name in cube.coords]
    fixed = [name for name in shown if cube[name].ndim == 0]
    return ", ".join(given(name, cube[name].item()) for name in fixed)


def check_picture(path: str | os.PathLike[str], *, force: bool = False, name: str = "out") -> Path:
    """Refuse a picture file that could not be written, before any work is done.

    Raises
    ------
    ParameterError
        If its ending is none of `PICTURES`.
    StoreError
        As for a cube.
    """
    return check_output(path, force=force, name=name, what="a picture", endings=PICTURES)


def write_picture(figure: Figure, path: str | os.PathLike[str], *, force: bool = False, **how: Any) -> None:
    """Write `figure` to a file; `how` is handed to `Figure.savefig`.

    Raises
    ------
    ParameterError, StoreError
        As by `check_picture`; or the disk refuses.
    """
    path = check_picture(path, force=force, name="picture")
    with told(f"picture = {path}", ""), replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."), **{"dpi": DPI} | how)

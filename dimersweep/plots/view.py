"""Build a page of HTML that plays a run in a browser without a network, from the data of the run."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from dimersweep.cubes.seen_run import SeenRun, check_shown, meanings
from dimersweep.inputs import check_count, number
from dimersweep.parameters import reduced
from dimersweep.plots.playback import BALLS, MARKS, MOST_FRAMES, ROD, Playback, frames, playback_of
from dimersweep.plots.style import MODE_COLORS
from dimersweep.plots.tables import repeats_in, run_rows
from dimersweep.symbols import BASE, LEFT_OUT, START, is_angle, units_of

FRAMES_A_PERIOD = 100  # most frames of a period: the curves of the page are drawn through them
TRACK_POINTS = 400  # points of the track of a whole run
SHOWN_DIGITS = 4  # digits of the radius of a ball; all coordinates have as many decimals as that
USUAL_SPEED = 0.1  # seconds of the run in a second of the page
PAGE = Path(__file__).with_name("view.html")
IFRAME = '<iframe title="dimersweep" style="width: 100%; height: 720px; border: 0" {}></iframe>'


@dataclass(frozen=True, repr=False)
class View:
    """Page of HTML, complete in itself, that shows itself in a notebook."""

    html: str

    def _repr_html_(self) -> str:
        return IFRAME.format(f'srcdoc="{escape(self.html)}"')


def stretch_of(run: SeenRun, periods: int, *, last: bool) -> Playback:
    """Return the part of a run that a page shows, in as many frames as its curves need; a period takes a second."""
    check_shown(run, "view")
    fps = max(1, min(FRAMES_A_PERIOD, MOST_FRAMES // check_count("periods", periods)))
    return playback_of(run, periods, 1 / run.parameters["f"], fps, last=last)


def seen(run: SeenRun, playback: Playback, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the data of a run for a page: its verdict, its numbers, its code with `settings`, its pictures [mm]."""
    shown = frames(run, playback)
    (first, second), centre = shown.balls[0], shown.centre[0]
    digits = SHOWN_DIGITS - int(np.ceil(np.log10(shown.radii.min())))
    track = run.states(np.linspace(0, run.duration, TRACK_POINTS))
    settings = {"periods": run.n_periods} if settings is None else settings
    return {
        "mode": run.mode + repeats_in(run),
        "color": MODE_COLORS[run.mode],
        "says": meanings(run)[run.mode] + ("" if run.status == "ok" else f" ({run.message})"),
        "conditions": run.conditions(),
        "numbers": run_rows(run)[1:],  # without the parameters, which are in `conditions`
        "given": {name: as_shown(name, value) for name, value in changed(run).items()},
        "copy": written(run, settings),
        "f": run.parameters["f"],
        "radii": shown.radii.tolist(),
        "rod": 1e3 * run.parameters["D_r"],
        # distance of the centre of mass from ball 1, over the distance of the balls
        "share": float(np.linalg.norm(centre - first) / np.linalg.norm(second - first)),
        "room": shown.room.as_matrix().tolist(),
        "pace": playback.fps / playback.speed,
        "cycles": np.round(shown.cycles, 4).tolist(),
        "balls": np.round(shown.balls, digits).reshape(-1, 6).tolist(),
        "mark": np.round(shown.mark, 3).tolist(),
        "plate": np.round(shown.plate, digits).tolist(),
        "away": np.round(shown.away, digits).tolist(),
        "track": np.round(np.column_stack([1e3 * track[axis] for axis in "xy"]), digits).tolist(),
    }


def changed(run: SeenRun) -> dict[str, float]:
    """Return the parameters of a run that differ from the base case."""
    usual = LEFT_OUT | BASE
    return {name: value for name, value in reduced(run.parameters).items() if value != usual.get(name)}


def as_shown(name: str, value: float) -> str:
    """Return a value of a parameter as text in the unit in which it is shown, without the unit."""
    return f"{degrees(value) if is_angle(name) else 1e3 * value if units_of(name) == 'mm' else value:.12g}"


def written(run: SeenRun, settings: Mapping[str, Any]) -> dict[str, str]:
    """Return code that makes a run again, by the names Python, command, and TOML (a sweep file of one point).

    A run that starts from a given state has Python only.
    """
    values: dict[str, Any] = {name: _exact(name, value) for name, value in changed(run).items()}
    begun = getattr(run, "start", None)
    if begun is not None:
        values = {"start": begun} | {name: value for name, value in values.items() if name not in START}
    arguments = ", ".join(f"{name}={value!r}" for name, value in {**values, **settings}.items())
    python = f"import dimersweep\n\nrun = dimersweep.simulate({arguments})\nprint(run, run.orbit, sep='\\n')\n"
    if begun is not None:
        return {"Python": python}
    options = values | {name: settings[name] for name in ("periods", "rtol") if name in settings}
    command = "".join(f" --{name} {str(value).replace(' ', '')}" for name, value in options.items())
    command += " --stop-when-settled" if settings.get("stop_when_settled") else ""
    sweep = {"title": "one point", **settings, "output": "point.nc"}
    grid = {"Gamma": [values.pop("Gamma", BASE["Gamma"])]}
    sections = {"sweep": sweep, "grid": grid, "fixed": values}
    lines = [
        f"[{name}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in section.items())
        for name, section in sections.items()
    ]
    return {"Python": python, "command": f"dimersweep simulate{command}", "TOML": "\n".join(lines)}


def _exact(name: str, value: float) -> float | str:
    """Return a value that is read back as exactly this number: an angle as text in degrees, if that is possible."""
    text = f"{as_shown(name, value)} deg" if is_angle(name) else ""
    return text if text and number(name, text) == value else value


def filled(content: Mapping[str, Any], title: str, html: str = "") -> str:
    """Return the page with a title, with the data `content`, and with `html` next to its pictures.

    Nothing in the data is markup.
    """
    look = {"balls": BALLS, "rod": ROD, "marks": MARKS}
    data = json.dumps({"look": look, **content}, allow_nan=False).replace("<", "\\u003c")
    page = PAGE.read_text(encoding="utf-8").replace("<!-- beside -->", html)
    return page.replace("<!-- title -->", escape(title)).replace('"told"', data)


def page_of(run: SeenRun, playback: Playback, speed: float | None = None) -> str:
    """Return a page of one run, which needs no network and no other program.

    It plays at `speed`, by default that of the playback.
    """
    return filled({"run": seen(run, playback), "speed": playback.speed if speed is None else speed}, run.conditions())

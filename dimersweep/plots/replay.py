"""A run to turn around: one page of HTML that holds its own script (plotly) and shows the motion in three dimensions."""

from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from dimersweep.cubes.seen_run import SeenRun
from dimersweep.errors import StoreError
from dimersweep.parameters import dimer_from
from dimersweep.plots.playback import BALLS, PLATE, ROD, TRACK, Playback, frames, radii_of

RINGS, SPOKES = 9, 14  # of the mesh of a ball
SHOWN_DIGITS = 4  # of the radius of a ball, and as many places in all coordinates
PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{heading}</title>
<style>
body {{ margin: 0; height: 100vh; box-sizing: border-box; padding-bottom: 12px; font-family: sans-serif }}
body {{ display: flex; flex-direction: column }}
h1 {{ margin: 0.6em 0.8em 0; font-size: 14px; font-weight: normal; text-align: center }}
body > div {{ flex: 1; min-height: 0 }}
</style>
</head>
<body>
<h1>{heading}</h1>
{scene}
</body>
</html>
"""
PLAYER = """
const view = document.getElementById("{plot_id}");
const still = {"mode": "immediate", "frame": {"duration": 0, "redraw": true}, "transition": {"duration": 0}};
let shown = 0, begun = null;  // the frame that is shown, and the moment at which the play began
async function play(fps, count) {
  const mine = begun = performance.now(), first = shown < count - 1 ? shown : -1;
  while (begun === mine) {
    const now = await new Promise(requestAnimationFrame);
    const due = Math.min(count - 1, first + Math.max(0, Math.ceil((now - mine) * fps / 1000)));
    if (begun === mine && due !== shown) {  // frames that the machine has no time to draw are left out
      shown = due;
      await Plotly.animate(view, [String(due)], still).catch(() => {});
    }
    if (due === count - 1) break;
  }
}
view.on("plotly_buttonclicked", ({button}) => { begun = null; if (button.label === "play") play(...button.args); });
view.on("plotly_sliderchange", ({slider, interaction}) => { if (interaction) { begun = null; shown = slider.active; } });
"""


def replay_page(run: SeenRun, playback: Playback) -> str:
    """The page of a recorded run.

    Raises
    ------
    StoreError
        If plotly is not installed.
    """
    try:
        from plotly.graph_objects import Figure
    except ImportError:
        raise StoreError("a page needs plotly; pip install 'dimersweep[movie]'") from None
    shown = frames(run, playback)
    data, layout = _scene(run, shown), _layout(run, shown, playback)
    steps = [
        {"name": str(k), "data": _moved(run, shown, k), "traces": [0, 1, 2, 3, 4]} for k in range(shown.sizes["time"])
    ]
    figure = Figure(data=data, layout=layout, frames=steps)
    how = {"include_plotlyjs": True, "full_html": False, "auto_play": False, "config": {"displaylogo": False}}
    scene = figure.to_html(**how, post_script=PLAYER)
    return PAGE.format(heading=f"{run.mode}: {run.conditions()}", scene=scene)


def _ball(r: float) -> tuple[np.ndarray, dict[str, list[int]]]:
    """Points of a sphere about the origin, shape (n, 3), and its triangles."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, RINGS)
    longitude = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)
    north, east = np.meshgrid(latitude, longitude, indexing="ij")
    points = r * np.column_stack(
        [(np.cos(north) * np.cos(east)).ravel(), (np.cos(north) * np.sin(east)).ravel(), np.sin(north).ravel()]
    )
    corners = []
    for ring in range(RINGS - 1):
        for k in range(SPOKES):
            a, b = ring * SPOKES + k, ring * SPOKES + (k + 1) % SPOKES
            corners += [(a, b, b + SPOKES), (a, b + SPOKES, a + SPOKES)]
    i, j, k = np.array(corners).T.tolist()
    return points, {"i": i, "j": j, "k": k}


def _xyz(run: SeenRun, points: np.ndarray) -> dict[str, list[float]]:
    """Columns of points in mm, short enough for a page."""
    rounded = np.round(points, SHOWN_DIGITS - int(np.ceil(np.log10(min(radii_of(run)))))).T.tolist()
    return dict(zip("xyz", rounded, strict=True))


def _in_room(run: SeenRun, points: np.ndarray, away: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Points, shape (n, 3), relative to a plate that is `away` along itself, turned with it: up is up."""
    dimer = dimer_from(run.parameters)
    fall = complex(dimer.fall_x, dimer.fall_y)
    tilt, azimuth = np.arctan2(abs(fall), dimer.g), np.angle(fall)
    u, v, c, s = np.cos(azimuth), np.sin(azimuth), np.cos(tilt), np.sin(tilt)
    falls, level, normal = np.array([u * c, v * c, -s]), np.array([-v, u, 0.0]), np.array([u * s, v * s, c])
    axes = np.array([u * falls - v * level, v * falls + u * level, normal])  # X, Y and Z of the plate, in the room
    return np.asarray((points + np.asarray(away)) @ axes)


def _away(shown: xr.Dataset, k: int) -> list[float]:
    """How far the plate is away along itself in frame k [mm]."""
    return [1e3 * shown["away_x"].values[k], 1e3 * shown["away_y"].values[k], 0.0]


def _centre(shown: xr.Dataset, k: int, ball: int) -> np.ndarray:
    """Centre of a ball (1 or 2) in frame k [mm]."""
    return 1e3 * np.array([shown[f"{axis}{ball}"].values[k] for axis in "xyz"])


def _span(shown: xr.Dataset, axis: str, room: float) -> list[float]:
    """Least and greatest coordinate that is shown, with room around the balls [mm]; heights from below the plate."""
    values = 1e3 * np.concatenate([shown[f"{axis}1"].values, shown[f"{axis}2"].values])
    lowest = 1e3 * shown["plate"].min().item() if axis == "z" else values.min() - room
    return [float(lowest), float(values.max() + (room / 2 if axis == "z" else room))]


def _box(run: SeenRun, spans: list[list[float]]) -> dict[str, list[float]]:
    """Least and greatest coordinate in the room of all that is shown of a plate with these spans [mm]."""
    corners = _in_room(run, np.array(list(product(*spans))))
    return {
        axis: [float(low), float(high)] for axis, low, high in zip("xyz", corners.min(0), corners.max(0), strict=True)
    }


def _plate(shown: xr.Dataset, r: float, k: int) -> np.ndarray:
    """Corners of the piece of plate that is shown, at its height in frame k, shape (4, 3) [mm]."""
    (left, right), (near, far) = (_span(shown, axis, 4 * r) for axis in "xy")
    x, y = [left, right, right, left], [near, near, far, far]
    z = [1e3 * shown["plate"].values[k]] * 4
    return np.column_stack([x, y, z])


def _moved(run: SeenRun, shown: xr.Dataset, k: int) -> list[dict[str, Any]]:
    """What of the scene is new in frame k."""
    radii = radii_of(run)
    (small, _), (other, _) = _ball(radii[0]), _ball(radii[1])
    first, second = _centre(shown, k, 1), _centre(shown, k, 2)
    path = np.column_stack([shown["x"][: k + 1], shown["y"][: k + 1], shown["z"][: k + 1]]) * 1e3
    ends = np.array([first, second])
    kinds = ("mesh3d", "mesh3d", "scatter3d", "mesh3d", "scatter3d")
    places = (first + small, second + other, ends, _plate(shown, max(radii), k), path[-1:])
    turned = [_xyz(run, _in_room(run, place, _away(shown, k))) for place in places]
    return [{"type": kind} | place for kind, place in zip(kinds, turned, strict=True)]


def _scene(run: SeenRun, shown: xr.Dataset) -> list[dict[str, Any]]:
    """The scene in its first frame: two balls, rod, plate, centre of mass; and the whole track."""
    _, triangles = _ball(1.0)
    light = {"ambient": 0.45, "diffuse": 0.8, "specular": 0.3}
    looks: list[dict[str, Any]] = [
        {"color": BALLS[0], "name": "p1", "flatshading": False, "lighting": light, "showlegend": True} | triangles,
        {"color": BALLS[1], "name": "p2", "flatshading": False, "lighting": light, "showlegend": True} | triangles,
        {"mode": "lines", "line": {"color": ROD, "width": 9}, "name": "rod", "showlegend": False},
        {"color": PLATE, "opacity": 0.55, "name": "plate", "i": [0, 0], "j": [1, 2], "k": [2, 3], "showlegend": True},
        {"mode": "markers", "marker": {"color": TRACK, "size": 3}, "name": "centre of mass", "showlegend": False},
    ]
    moving = [place | look | {"hoverinfo": "name"} for place, look in zip(_moved(run, shown, 0), looks, strict=True)]
    path = 1e3 * np.column_stack([shown["x"], shown["y"], shown["z"]])
    line = {"color": TRACK, "width": 3}
    track = {"type": "scatter3d", "mode": "lines", "line": line, "name": "track", "hoverinfo": "skip"}
    return [*moving, track | _xyz(run, _in_room(run, path))]


def _layout(run: SeenRun, shown: xr.Dataset, playback: Playback) -> dict[str, Any]:
    """Axes in true proportion, a button to play and one to pause, and a slider over the frames."""
    still = {"mode": "immediate", "frame": {"duration": 0, "redraw": True}, "transition": {"duration": 0}}
    cycles = shown["time"].values * run.parameters["f"]
    slider = {
        "currentvalue": {"prefix": "forcing period ", "xanchor": "right"},
        "pad": {"t": 10},
        "steps": [
            {"method": "animate", "label": f"{cycles[k]:.2f}", "args": [[str(k)], still]} for k in range(cycles.size)
        ],
    }
    buttons = [
        {"label": "play", "method": "skip", "args": [playback.fps, cycles.size]},  # see `PLAYER`
        {"label": "pause", "method": "skip", "args": []},
    ]
    play = {"x": 0.03, "xanchor": "left", "y": 0, "yanchor": "top", "pad": {"t": 0}}  # left of the slider's number
    room = 4 * max(radii_of(run))
    spans = _box(run, [_span(shown, axis, room) for axis in "xyz"])
    widest = max(high - low for low, high in spans.values())
    ratio = {axis: (high - low) / widest for axis, (low, high) in spans.items()}
    ticks = {axis: max(3, round(8 * share)) for axis, share in ratio.items()}
    axes = {
        f"{axis}axis": {"title": {"text": f"{axis} [mm]"}, "range": span, "nticks": ticks[axis]}
        for axis, span in spans.items()
    }
    return {
        "scene": axes
        | {"aspectmode": "manual", "aspectratio": ratio, "camera": {"eye": {"x": 0.85, "y": -1.1, "z": 0.68}}},
        "updatemenus": [play | {"type": "buttons", "direction": "left", "buttons": buttons}],
        "sliders": [slider | {"x": 0.03, "len": 0.94}],
        "legend": {"orientation": "h", "x": 0.5, "xanchor": "center", "y": 1, "yanchor": "bottom"},
        "margin": {"l": 0, "r": 0, "t": 30, "b": 30},
    }

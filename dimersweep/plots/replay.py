"""A run to turn around: one page of HTML that holds its own script (plotly) and shows the motion in three dimensions."""

from itertools import product
from typing import Any

import numpy as np

from dimersweep.cubes.seen_run import SeenRun
from dimersweep.errors import StoreError
from dimersweep.plots.playback import BALLS, PATH_COLOR, PLATE, ROD, Frames, Playback, frames

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
    traces = list(range(len(LOOKS)))
    steps = [{"name": str(k), "data": _moved(shown, k), "traces": traces} for k in range(shown.cycles.size)]
    figure = Figure(data=_scene(shown), layout=_layout(shown, playback.fps), frames=steps)
    how = {"include_plotlyjs": True, "full_html": False, "auto_play": False, "config": {"displaylogo": False}}
    scene = figure.to_html(**how, post_script=PLAYER)
    return PAGE.format(heading=f"{run.mode}: {run.conditions()}", scene=scene)


def _ball(r: float) -> np.ndarray:
    """Points of a sphere about the origin, shape (n, 3), ring by ring."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, RINGS)
    longitude = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)
    north, east = (each.ravel() for each in np.meshgrid(latitude, longitude, indexing="ij"))
    return r * np.column_stack([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)])


def _triangles() -> dict[str, list[int]]:
    """The corners of the triangles of a ball, by their numbers: two for each spoke between two rings."""
    a = np.arange((RINGS - 1) * SPOKES)
    b = a - a % SPOKES + (a + 1) % SPOKES
    i, j, k = np.transpose([[a, b, b + SPOKES], [a, b + SPOKES, a + SPOKES]], (1, 2, 0)).reshape(3, -1).tolist()
    return {"i": i, "j": j, "k": k}


LIGHT = {"ambient": 0.45, "diffuse": 0.8, "specular": 0.3}
BALL = {"flatshading": False, "lighting": LIGHT, "showlegend": True} | _triangles()
LOOKS: tuple[dict[str, Any], ...] = (  # of what moves, in the order of `_moved`
    {"type": "mesh3d", "color": BALLS[0], "name": "p1"} | BALL,
    {"type": "mesh3d", "color": BALLS[1], "name": "p2"} | BALL,
    {"type": "scatter3d", "mode": "lines", "line": {"color": ROD, "width": 9}, "name": "rod", "showlegend": False},
    {"type": "mesh3d", "color": PLATE, "opacity": 0.55, "name": "plate", "showlegend": True}
    | {"i": [0, 0], "j": [1, 2], "k": [2, 3]},
    {"type": "scatter3d", "mode": "markers", "marker": {"color": PATH_COLOR, "size": 3}, "name": "centre of mass"}
    | {"showlegend": False},
)


def _xyz(shown: Frames, points: np.ndarray) -> dict[str, list[float]]:
    """Columns of points on the plate [mm] as they are in the room, short enough for a page."""
    digits = SHOWN_DIGITS - int(np.ceil(np.log10(shown.radii.min())))
    return dict(zip("xyz", np.round(shown.room.apply(points), digits).T.tolist(), strict=True))


def _spans(shown: Frames) -> np.ndarray:
    """Least and greatest coordinate on the plate with room around the balls, shape (3, 2) [mm]; heights from the plate."""
    balls, room = shown.balls.reshape(-1, 3), 4 * shown.radii.max() * np.array([1, 1, 0.5])
    low, high = balls.min(axis=0) - room, balls.max(axis=0) + room
    low[2] = shown.plate.min()
    return np.column_stack([low, high])


def _moved(shown: Frames, k: int) -> list[dict[str, Any]]:
    """What of the scene is new in frame k: two balls, rod, plate, centre of mass."""
    (left, right), (near, far), _ = _spans(shown)
    balls = [centre + _ball(r) for centre, r in zip(shown.balls[k], shown.radii, strict=True)]
    z = shown.plate[k]
    plate = np.array([[left, near, z], [right, near, z], [right, far, z], [left, far, z]])
    places = (*balls, shown.balls[k], plate, shown.centre[[k]])
    return [
        {"type": look["type"]} | _xyz(shown, place + shown.away[k]) for look, place in zip(LOOKS, places, strict=True)
    ]


def _scene(shown: Frames) -> list[dict[str, Any]]:
    """The scene in its first frame, and the whole track."""
    line = {"color": PATH_COLOR, "width": 3}
    track = {"type": "scatter3d", "mode": "lines", "line": line, "name": "track", "hoverinfo": "skip"}
    moving = [place | look | {"hoverinfo": "name"} for place, look in zip(_moved(shown, 0), LOOKS, strict=True)]
    return [*moving, track | _xyz(shown, shown.centre)]


def _layout(shown: Frames, fps: int) -> dict[str, Any]:
    """Axes in true proportion, a button to play and one to pause, and a slider over the frames."""
    still = {"mode": "immediate", "frame": {"duration": 0, "redraw": True}, "transition": {"duration": 0}}
    slider = {
        "currentvalue": {"prefix": "forcing period ", "xanchor": "right"},
        "pad": {"t": 10},
        "steps": [
            {"method": "animate", "label": f"{cycle:.2f}", "args": [[str(k)], still]}
            for k, cycle in enumerate(shown.cycles)
        ],
    }
    buttons = [
        {"label": "play", "method": "skip", "args": [fps, shown.cycles.size]},  # see `PLAYER`
        {"label": "pause", "method": "skip", "args": []},
    ]
    play = {"x": 0.03, "xanchor": "left", "y": 0, "yanchor": "top", "pad": {"t": 0}}  # left of the slider's number
    corners = shown.room.apply(list(product(*_spans(shown))))
    low, high = corners.min(axis=0), corners.max(axis=0)
    shares = dict(zip("xyz", (high - low) / (high - low).max(), strict=True))
    axes = {
        f"{axis}axis": {"title": {"text": f"{axis} [mm]"}, "range": span, "nticks": max(3, round(8 * shares[axis]))}
        for axis, span in zip("xyz", np.column_stack([low, high]).tolist(), strict=True)
    }
    return {
        "scene": axes
        | {"aspectmode": "manual", "aspectratio": shares, "camera": {"eye": {"x": 0.85, "y": -1.1, "z": 0.68}}},
        "updatemenus": [play | {"type": "buttons", "direction": "left", "buttons": buttons}],
        "sliders": [slider | {"x": 0.03, "len": 0.94}],
        "legend": {"orientation": "h", "x": 0.5, "xanchor": "center", "y": 1, "yanchor": "bottom"},
        "margin": {"l": 0, "r": 0, "t": 30, "b": 30},
    }

"""SeenRun to look at: the dimer on its shaking plate from the side and from above, as a GIF, a video, or frames of a page."""

import os
import shutil
import subprocess
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from PIL import Image

from dimersweep.cubes.seen_run import SeenRun
from dimersweep.errors import StoreError
from dimersweep.inputs import check_count
from dimersweep.parameters import dimer_from
from dimersweep.plots.playback import BALLS, MOST_FRAMES, PLATE, ROD, TRACK, Playback, frames, radii_of
from dimersweep.plots.style import entitle
from dimersweep.storage.files import disk_errors, put, replacing
from dimersweep.storage.outputs import check_ending, check_writable

MOVIES = (".gif", ".mp4", ".html")
MOST_DPI = 600
MOST_FPS_OF_GIF = 50  # browsers show a delay below two hundredths of a second as ten
COLORS_OF_GIF = 64


def check_movie(path: str | os.PathLike[str], *, force: bool) -> Path:
    """Refuse a movie file that could not be written, before any work is done.

    Raises
    ------
    ParameterError
        If its ending is none of `MOVIES`.
    StoreError
        As for a cube; or a video is asked for and there is no ffmpeg.
    """
    path = Path(path)
    check_ending(os.fspath(path), name="movie", what="a movie", endings=MOVIES)
    if path.suffix == ".mp4" and _ffmpeg() is None:
        raise StoreError(
            f"movie = {path}: a video needs ffmpeg; pip install 'dimersweep[movie]', or write a .gif or .html"
        )
    return check_writable(path, force=force, name="movie")


def _ffmpeg() -> str | None:
    """The program ffmpeg: the system's, or that of the package imageio-ffmpeg; None if there is neither."""
    found = shutil.which("ffmpeg")
    if found is None:
        with suppress(ImportError, RuntimeError):  # not installed, or installed without its program
            from imageio_ffmpeg import get_ffmpeg_exe

            found = get_ffmpeg_exe()
    return found


def write_movie(run: SeenRun, path: str | os.PathLike[str], playback: Playback, dpi: int, *, force: bool) -> Path:
    """Write a movie of a recorded run, see `Run.animate`.

    Raises
    ------
    ParameterError, StoreError
    """
    path = check_movie(path, force=force)
    dpi = check_count("dpi", dpi, MOST_DPI)
    if path.suffix == ".html":
        from dimersweep.plots.replay import replay_page

        try:
            page = replay_page(run, playback)
        except StoreError as error:
            raise StoreError(f"movie = {path}: {error}") from None
        with disk_errors(f"movie = {path}", ""):
            put(path, [page.encode()])
        return path
    if path.suffix == ".gif" and playback.fps > MOST_FPS_OF_GIF:
        most = f"a GIF shows at most {MOST_FPS_OF_GIF} frames a second, and has {MOST_FPS_OF_GIF}"
        warnings.warn(f"fps = {playback.fps}: {most}; a video has more", RuntimeWarning, stacklevel=3)
        playback = replace(playback, fps=MOST_FPS_OF_GIF)
    with disk_errors(f"movie = {path}", ""), replacing(path) as temporary:
        (_write_gif if path.suffix == ".gif" else _write_video)(temporary, _rendered(run, playback, dpi), playback.fps)
    return path


def _write_gif(path: Path, pictures: Iterator[np.ndarray], fps: int) -> None:
    """Frames of shape (height, width, 3) as an endless GIF with one palette.

    Delays are whole hundredths of a second; what is left over of one goes to the next.
    """
    first = Image.fromarray(next(pictures)).quantize(COLORS_OF_GIF)
    others = (Image.fromarray(each).quantize(palette=first, dither=Image.Dither.NONE) for each in pictures)
    delays = np.diff(np.round(100 * np.arange(MOST_FRAMES + 1) / fps).astype(int))
    how: dict[str, Any] = {"duration": (10 * delays).tolist(), "loop": 0, "optimize": True}
    first.save(path, format="GIF", save_all=True, append_images=others, **how)


def _write_video(path: Path, pictures: Iterator[np.ndarray], fps: int) -> None:
    """Frames of shape (height, width, 3) as H.264, which takes even sizes only."""
    first = next(pictures)
    height, width, _ = first.shape
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps), "-i", "-"]
    target = ["-an", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-pix_fmt", "yuv420p"]
    command = [str(_ffmpeg()), "-y", "-loglevel", "error", *source, *target, "-f", "mp4", str(path)]
    data = b"".join(each.tobytes() for each in chain([first], pictures))
    done = subprocess.run(command, input=data, capture_output=True, check=False)
    if done.returncode != 0:
        raise OSError(done.stderr.decode(errors="replace").strip().splitlines()[-1])


def _rendered(run: SeenRun, playback: Playback, dpi: int) -> Iterator[np.ndarray]:
    """Pictures of the frames, shape (height, width, 3), uint8: what stands still is drawn once."""
    shown = frames(run, playback)
    figure = Figure(figsize=(7.2, 3.7), layout="constrained", dpi=dpi)
    canvas = FigureCanvasAgg(figure)
    side, above = figure.subplots(1, 2, width_ratios=(1.25, 1))
    updates = _side_view(side, run, shown), _view_from_above(above, run, shown)
    words = run.conditions(tex=True)
    heading = entitle(figure, f" \n{words}")
    for artist in (heading, *updates[0](0), *updates[1](0)):
        artist.set_animated(True)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)
    for k, cycles in enumerate(shown["time"].values * run.parameters["f"]):
        now = f"{run.mode}, forcing period {int(cycles)}, {360 * (cycles % 1):3.0f}° of the plate"
        heading.set_text(f"{now}\n{words}")
        canvas.restore_region(still)
        for axes, update in zip((side, above), updates, strict=True):
            for artist in update(k):
                axes.draw_artist(artist)
        figure.draw_artist(heading)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _side_view(axes: Axes, run: SeenRun, shown: xr.Dataset) -> Callable[[int], list[Any]]:
    """Seen along the plate, square to the rod, as it tilts and moves there: p1 stands still on it, and up is up."""
    dimer = dimer_from(run.parameters)
    radii, length = radii_of(run), dimer.l
    across = 1e3 * length * np.cos(shown["beta"].values)
    z1, z2, plate = (1e3 * shown[name].values for name in ("z1", "z2", "plate"))
    r = max(radii)
    cos_a, sin_a = -np.sin(shown["theta"].values), np.cos(shown["theta"].values)  # of the rod on the plate
    away = 1e3 * (shown["away_x"].values * cos_a + shown["away_y"].values * sin_a)
    falls = np.arctan2(dimer.fall_x * cos_a + dimer.fall_y * sin_a, dimer.g)
    left, right, top = -3 * r, 1e3 * length + 3 * r, max(z1.max(), z2.max()) + 2 * r
    corners = np.array([(u, v) for u in (left, right) for v in (plate.min() - r, top)]).T
    seen = np.array([_turned(corners + np.array([[by], [0]]), -angle) for by, angle in zip(away, falls, strict=True)])
    table = Rectangle((-3 * r, 0), 1e3 * length + 6 * r, r / 2, color=PLATE)
    axes.add_patch(table)
    (rod,) = axes.plot([], [], color=ROD, linewidth=3, solid_capstyle="round")
    balls = [Circle((0, 0), radius, color=color) for radius, color in zip(radii, BALLS, strict=True)]
    for ball in balls:
        axes.add_patch(ball)
    axes.set_xlim(seen[:, 0].min(), seen[:, 0].max())
    axes.set_ylim(seen[:, 1].min(), seen[:, 1].max())
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("along the rod [mm]")
    axes.set_ylabel("height [mm]")
    axes.set_title("from the side", fontsize=9)
    for name, color, at in (("$p_1$", BALLS[0], 0.02), ("$p_2$", BALLS[1], 0.12)):
        axes.text(at, 0.98, name, color=color, transform=axes.transAxes, va="top")

    def update(k: int) -> list[Any]:
        balls[0].center, balls[1].center = (0.0, z1[k]), (across[k], z2[k])
        rod.set_data([0.0, across[k]], [z1[k], z2[k]])
        table.set_y(plate[k] - r / 2)
        place = Affine2D().translate(away[k], 0).rotate(-falls[k]) + axes.transData
        for artist in (table, rod, *balls):
            artist.set_transform(place)
        return [table, rod, *balls]

    return update


def _turned(points: np.ndarray, angle: float) -> np.ndarray:
    """Points, shape (2, n), turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    turned: np.ndarray = np.array([[c, -s], [s, c]]) @ points
    return turned


def _view_from_above(axes: Axes, run: SeenRun, shown: xr.Dataset) -> Callable[[int], list[Any]]:
    """Seen from above, with the track of the centre of mass on the plate; a plate that moves sideways is shown to."""
    radii = radii_of(run)
    r = max(radii)
    x, y = (1e3 * shown[name].values for name in ("x", "y"))
    ends = [(1e3 * shown[f"x{k}"].values, 1e3 * shown[f"y{k}"].values) for k in (1, 2)]
    (track,) = axes.plot([], [], color=TRACK, linewidth=1.2)
    (rod,) = axes.plot([], [], color=ROD, linewidth=3, solid_capstyle="round")
    balls = [Circle((0, 0), radius, color=color) for radius, color in zip(radii, BALLS, strict=True)]
    for ball in balls:
        axes.add_patch(ball)
    away = 1e3 * np.column_stack([shown["away_x"], shown["away_y"]])
    allx, ally = np.concatenate([e[0] for e in ends]), np.concatenate([e[1] for e in ends])
    half, moves = max(np.ptp(allx), np.ptp(ally)) / 2 + 2 * r, np.abs(away).max()
    middle = (allx.min() + allx.max()) / 2, (ally.min() + ally.max()) / 2
    corner = middle[0] - half, middle[1] - half
    table = Rectangle(corner, 2 * half, 2 * half, color=PLATE, alpha=0.25, visible=moves > 0, zorder=0)
    axes.add_patch(table)
    axes.set_xlim(middle[0] + (half + 1.5 * moves) * np.array([-1, 1]))
    axes.set_ylim(middle[1] + (half + 1.5 * moves) * np.array([-1, 1]))
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("$x$ [mm]")
    axes.set_ylabel("$y$ [mm]")
    axes.set_title("from above", fontsize=9)
    for each in (axes.xaxis, axes.yaxis):
        each.set_major_locator(MaxNLocator(4))

    def update(k: int) -> list[Any]:
        track.set_data(x[: k + 1], y[: k + 1])
        for ball, (u, v) in zip(balls, ends, strict=True):
            ball.center = (u[k], v[k])
        rod.set_data([ends[0][0][k], ends[1][0][k]], [ends[0][1][k], ends[1][1][k]])
        for artist in (table, track, rod, *balls):
            artist.set_transform(Affine2D().translate(*away[k]) + axes.transData)
        return [table, track, rod, *balls]

    return update

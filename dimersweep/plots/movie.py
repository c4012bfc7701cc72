"""Write movies of a run as a GIF, a video or a page: the dimer on its shaking plate from the side and from above."""

import os
import shutil
import subprocess
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from PIL import Image
from PIL.ImageColor import getrgb

from dimersweep.cubes.seen_run import SeenRun
from dimersweep.errors import StoreError
from dimersweep.inputs import check_count
from dimersweep.plots.playback import BALLS, MARKS, MOST_FRAMES, PATH_COLOR, PLATE, ROD, Frames, Playback, frames
from dimersweep.plots.style import entitle
from dimersweep.plots.view import page_of
from dimersweep.storage.files import disk_errors, replacing
from dimersweep.storage.outputs import check_output

MOVIES = (".gif", ".mp4", ".html")
MOST_DPI = 600
MOST_FPS_OF_GIF = 50  # browsers show a delay below two hundredths of a second as ten
COLORS_OF_GIF = 64
POLE_TO_POLE = np.linspace(0, np.pi, 24)[:, None]  # angles of the points of a mark on a ball, from pole to pole


def check_movie(path: str | os.PathLike[str], *, force: bool) -> Path:
    """Refuse a movie file that could not be written, before any work is done; return its path.

    Raises
    ------
    ParameterError
        If its ending is none of `MOVIES`.
    StoreError
        If the file could not be written, or a video is wanted and there is no ffmpeg.
    """
    path = check_output(path, force=force, name="movie", what="a movie", endings=MOVIES)
    if path.suffix == ".mp4" and _ffmpeg() is None:
        raise StoreError(
            f"movie = {path}: a video needs ffmpeg; pip install 'dimersweep[movie]', or write a .gif or .html"
        )
    return path


def _ffmpeg() -> str | None:
    """Return the path of ffmpeg: the system's, or that of the package imageio-ffmpeg; None if there is neither."""
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
        page = page_of(run, playback)
        with disk_errors(f"movie = {path}", ""), replacing(path) as temporary:
            temporary.write_bytes(page.encode())
        return path
    if path.suffix == ".gif" and playback.fps > MOST_FPS_OF_GIF:
        most = f"a GIF shows at most {MOST_FPS_OF_GIF} frames a second, and has {MOST_FPS_OF_GIF}"
        warnings.warn(f"fps = {playback.fps}: {most}; a video has more", RuntimeWarning, stacklevel=3)
        playback = replace(playback, fps=MOST_FPS_OF_GIF)
    with disk_errors(f"movie = {path}", ""), replacing(path) as temporary:
        (_write_gif if path.suffix == ".gif" else _write_video)(temporary, _rendered(run, playback, dpi), playback.fps)
    return path


def _write_gif(path: Path, pictures: Iterator[np.ndarray], fps: int) -> None:
    """Write frames, shape (height, width, 3), as an endless GIF with one palette.

    Delays are whole hundredths of a second. What rounding leaves over of one delay goes to the next.
    """
    begin = next(pictures)
    # the palette is made from the first frame, in which some of these colours may be hidden: 20 rows of them are added
    swatch = np.resize([getrgb(color) for color in (*BALLS, *MARKS)], begin[:20].shape)
    palette = Image.fromarray(np.concatenate([begin, swatch.astype(np.uint8)])).quantize(COLORS_OF_GIF)
    pictures = chain([begin], pictures)
    reduced = (Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures)
    delays = np.diff(np.round(100 * np.arange(MOST_FRAMES + 1) / fps).astype(int))
    how: dict[str, Any] = {"duration": (10 * delays).tolist(), "loop": 0, "optimize": True}
    next(reduced).save(path, format="GIF", save_all=True, append_images=reduced, **how)


def _write_video(path: Path, pictures: Iterator[np.ndarray], fps: int) -> None:
    """Write frames, shape (height, width, 3), as H.264; odd sizes are padded, as it takes even sizes only."""
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
    """Yield the pictures of the frames, shape (height, width, 3), uint8.

    Everything that stands still is drawn once and copied.
    """
    shown = frames(run, playback)
    figure = Figure(figsize=(7.2, 3.7), layout="constrained", dpi=dpi)
    canvas = FigureCanvasAgg(figure)
    side, above = figure.subplots(1, 2, width_ratios=(1.25, 1))
    updates = _side_view(side, shown), _view_from_above(above, shown)
    heading = entitle(figure, f" \n{run.conditions(tex=True)}")  # the first line is that of each frame
    line = figure.text(0.5, 1.0, "", fontsize=heading.get_fontsize(), ha="center", va="top")
    for artist in (line, *updates[0](0), *updates[1](0)):
        artist.set_animated(True)
    canvas.draw()
    line.set_position(heading.get_position())
    still = canvas.copy_from_bbox(figure.bbox)
    for k, cycles in enumerate(shown.cycles):
        line.set_text(f"{run.mode}, forcing period {int(cycles)}, {360 * (cycles % 1):3.0f}° of the plate")
        canvas.restore_region(still)
        for axes, update in zip((side, above), updates, strict=True):
            for artist in update(k):
                axes.draw_artist(artist)
        figure.draw_artist(line)
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _side_view(axes: Axes, shown: Frames) -> Callable[[int], list[Any]]:
    """Draw the view along the plate, square to the rod, and return the function that moves it to a frame.

    In this view p1 stays at one place of the plate. The plate tilts and moves as in the room: up is up.
    """
    across = np.einsum("ki,ki->k", shown.along, np.diff(shown.balls[..., :2], axis=1)[:, 0])
    balls = np.stack([np.column_stack([0 * across, across]), shown.balls[..., 2]], axis=2)
    length, r = np.linalg.norm(shown.balls[0, 1] - shown.balls[0, 0]), shown.radii.max()
    x, y, z = shown.room.as_matrix()[2]  # upward parts of the plate's axes
    falls = np.arctan2(-(shown.along @ [x, y]), z)
    places = [
        Affine2D().translate(away, 0).rotate(-angle)
        for away, angle in zip(np.einsum("ki,ki->k", shown.along, shown.away[:, :2]), falls, strict=True)
    ]
    left, right, top = -3 * r, length + 3 * r, balls[..., 1].max() + 2 * r
    corners = [(u, v) for u in (left, right) for v in (shown.plate.min() - r, top)]
    seen = np.concatenate([place.transform(corners) for place in places])
    table = Rectangle((left, 0), right - left, r / 2, color=PLATE)
    axes.add_patch(table)
    along = np.column_stack([shown.along, 0 * across])
    looks = np.stack([along, 0 * along + [0, 0, 1], np.cross(along, [0, 0, 1])], axis=1)
    move = _moving(axes, shown, balls, places, looks, table)
    xlim, ylim = np.transpose([seen.min(axis=0), seen.max(axis=0)])
    axes.set(xlim=xlim, ylim=ylim, aspect="equal", xlabel="along the rod [mm]", ylabel="height [mm]")
    axes.set_title("from the side", fontsize="small")
    for name, color, at in (("$p_1$", BALLS[0], 0.02), ("$p_2$", BALLS[1], 0.12)):
        axes.text(at, 0.98, name, color=color, transform=axes.transAxes, va="top")

    def update(k: int) -> list[Any]:
        table.set_y(shown.plate[k] - r / 2)
        return move(k)

    return update


def _view_from_above(axes: Axes, shown: Frames) -> Callable[[int], list[Any]]:
    """Draw the view from above, with the track of the centre of mass, and return the function that moves it to a frame.

    A plate that moves along itself is shown as a square.
    """
    ends = shown.balls[..., :2].reshape(-1, 2)
    moves = np.abs(shown.away).max()
    half, middle = np.ptp(ends, axis=0).max() / 2 + 2 * shown.radii.max(), (ends.min(axis=0) + ends.max(axis=0)) / 2
    table = Rectangle(middle - half, 2 * half, 2 * half, color=PLATE, alpha=0.25, visible=moves > 0, zorder=0)
    axes.add_patch(table)
    (track,) = axes.plot([], [], color=PATH_COLOR, linewidth=1.2)
    places = [Affine2D().translate(*away) for away in shown.away[:, :2]]
    looks = np.broadcast_to(np.eye(3), (len(places), 3, 3))
    move = _moving(axes, shown, shown.balls[..., :2], places, looks, table, track)
    xlim, ylim = middle[:, None] + (half + 1.5 * moves) * np.array([-1, 1])
    axes.set(xlim=xlim, ylim=ylim, aspect="equal", xlabel="$x$ [mm]", ylabel="$y$ [mm]")
    axes.set_title("from above", fontsize="small")
    for each in (axes.xaxis, axes.yaxis):
        each.set_major_locator(MaxNLocator(4))

    def update(k: int) -> list[Any]:
        track.set_data(*shown.centre[: k + 1, :2].T)
        return move(k)

    return update


def _moving(
    axes: Axes, shown: Frames, balls: np.ndarray, places: Sequence[Affine2D], looks: np.ndarray, *others: Any
) -> Callable[[int], list[Any]]:
    """Draw rod and balls into a view, and return the function that moves them to a frame.

    `others` are artists that move with the plate. `looks`, shape (n, 3, 3), has as rows the view's right, its up, and
    the direction towards the viewer, in each frame.
    """
    length = np.linalg.norm(np.diff(shown.balls[0], axis=0))
    (rod,) = axes.plot([], [], color=ROD, linewidth=3, solid_capstyle="round")
    circles = [Circle((0, 0), radius, color=color) for radius, color in zip(shown.radii, BALLS, strict=True)]
    for circle in circles:
        axes.add_patch(circle)
    marks = [axes.plot([], [], color=color, linewidth=1.5)[0] for _ in circles for color in MARKS]

    def move(k: int) -> list[Any]:
        axis = np.diff(shown.balls[k], axis=0)[0] / length
        for circle, centre in zip(circles, balls[k], strict=True):
            circle.center = tuple(centre)
        for line, (circle, side) in zip(marks, product(circles, (1, -1)), strict=True):
            seen = (np.cos(POLE_TO_POLE) * axis + side * np.sin(POLE_TO_POLE) * shown.mark[k]) @ looks[k].T
            line.set_data(*np.where(seen[:, 2:] > 0, circle.center + 0.92 * circle.radius * seen[:, :2], np.nan).T)
        rod.set_data(*balls[k].T)
        moved = [*others, rod, *circles, *marks]
        for artist in moved:
            artist.set_transform(places[k] + axes.transData)
        return moved

    return move

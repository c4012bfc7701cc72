"""Motion to look at: movies of a run, and a page that shows it in three dimensions, opened in a real browser."""

import re
import sys
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from dimersweep import simulate
from dimersweep.errors import ParameterError, StoreError
from dimersweep.plots import movie, view
from dimersweep.plots import playback as playing
from tests.browser import chromium_page, colors_of, needs_chromium
from tests.fakes import interrupts

pytestmark = pytest.mark.jit


@pytest.fixture(scope="module")
def run():
    return simulate(periods=60)


def test_frames_are_the_states_of_the_run(run):
    playback = playing.Playback(3.0, 3.2, 0.1, 25, False)
    shown = playing.frames(run, playback)
    states = run.states(3.0 + 0.004 * np.arange(50))
    np.testing.assert_allclose(shown.cycles, 15 * states["time"])
    np.testing.assert_allclose(np.linalg.norm(np.diff(shown.balls, axis=1), axis=2), 2 * 5 * 5)
    np.testing.assert_allclose(shown.balls[:, 1, 2], 5 + 1e3 * (states["gap_2"] + states["plate"]), atol=1e-12)


@pytest.mark.parametrize(("speed", "fps"), [(0.5, 25), (0.1, 60), (0.03, 7), (2.0, 10), (1.0, 1)])
def test_time_is_slow_around_double_impacts_however_far_apart_the_frames_are(speed, fps):
    """Each second of the run takes 1/speed, and SLOWED times that near an impact; whole, overlapping and cut spans alike."""
    T = 1 / 15
    impacts, reach = np.array([3.0, 3.0501, 3.0522, 3.07, 3.1]), playing.NEAR_IMPACT * T
    times = playing.Playback(3.0, 3.1, speed, fps, True).times(impacts, T)
    fine = np.linspace(3.0, 3.1, 1_000_001)
    slow = (np.abs(fine[:-1, None] + 5e-8 - impacts) < reach).any(axis=1)
    shown = np.concatenate([[0.0], np.cumsum(np.where(slow, playing.SLOWED, 1.0) * 1e-7 / speed)])
    np.testing.assert_allclose(np.interp(times, fine, shown), np.arange(times.size) / fps, atol=1e-5 / speed)
    assert times.size == np.ceil(shown[-1] * fps)
    assert slow.mean() == pytest.approx((reach + 0.0021 + 2 * reach + 2 * reach + reach) / 0.1, rel=1e-3)


def test_a_movie_has_as_many_frames_as_its_time_asks_for():
    for periods, speed, fps in ((3, 0.1, 10), (7, 0.1, 30), (6, 0.3, 50), (1, 0.7, 3)):
        length = periods / 15
        n = playing.Playback(4 - length, 4.0, speed, fps, False).times(np.array([]), 1 / 15).size
        assert n == int(np.ceil(round(length / speed * fps, 6)))


def test_a_gif_moves(run, tmp_path):
    assert run.animate(tmp_path / "run.gif", periods=2, fps=20) == tmp_path / "run.gif"
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames == len(np.arange(0, 2 / 15, 0.005))
        assert image.info["duration"] == 50
        assert "loop" in image.info and image.info["loop"] == 0
        first = np.asarray(image.convert("RGB"), dtype=int)
        image.seek(image.n_frames // 2)
        later = np.asarray(image.convert("RGB"), dtype=int)
    assert (np.abs(first - later).max(axis=2) > 60).sum() > 200
    colors = {tuple(color) for color in np.concatenate([first, later]).reshape(-1, 3) // 32}
    assert {(7, 7, 2), (1, 1, 1)} <= colors  # the marks of the balls: yellow and black


@pytest.mark.parametrize("fps", [7, 24, 30, 60, 120])
def test_a_gif_lasts_as_long_as_it_was_asked_to(run, tmp_path, fps):
    """Its delays are whole hundredths of a second, and browsers show one below two hundredths as ten."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        run.animate(tmp_path / "run.gif", periods=1, fps=fps, speed=0.2, dpi=15)
    with Image.open(tmp_path / "run.gif") as image:
        delays = [image.seek(k) or image.info["duration"] for k in range(image.n_frames)]
    made = min(fps, 50)
    assert sum(delays) == pytest.approx(1e3 * np.ceil(round(1 / 15 / 0.2 * made, 6)) / made, abs=5.01)
    assert min(delays) >= 20 and max(delays) - min(delays) <= 10
    said = [str(each.message) for each in told]
    assert said == ([f"fps = {fps}: a GIF shows at most 50 frames a second, and has 50; a video has more"] * (fps > 50))


def test_a_video_is_a_video(run, tmp_path):
    if movie._ffmpeg() is None:
        pytest.skip("there is no ffmpeg")
    run.animate(tmp_path / "run.mp4", periods=1)
    assert (tmp_path / "run.mp4").read_bytes()[4:8] == b"ftyp"


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"periods": 0}, r"^periods = 0: must be a whole number >= 1$"),
        ({"speed": 0}, r"^speed = 0.0: must be > 0$"),
        ({"dpi": 0}, r"^dpi = 0: must be a whole number >= 1$"),
        ({"dpi": 10_000}, r"^dpi = 10000: must be <= 600$"),
        ({"periods": 60, "speed": 0.001}, r"^animate: 100000 frames; at most 2000: give fewer periods or more speed$"),
    ],
)
def test_a_movie_that_cannot_be_is_refused(run, tmp_path, how, message):
    with pytest.raises(ParameterError, match=message):
        run.animate(tmp_path / "run.gif", **how)
    assert not list(tmp_path.iterdir())


def test_a_movie_needs_a_known_ending_and_its_program(run, tmp_path, monkeypatch):
    with pytest.raises(ParameterError, match=r"a movie must end in .gif, .mp4 or .html$"):
        run.animate(tmp_path / "run.avi")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(StoreError, match=r"a video needs ffmpeg; pip install 'dimersweep\[movie\]'"):
        run.animate(tmp_path / "run.mp4")
    with pytest.raises(ParameterError, match="nothing was recorded"):
        simulate(periods=1, record=False).animate(tmp_path / "run.gif")


def two_frames(*rest):
    yield from np.zeros((2, 10, 10, 3), dtype=np.uint8)
    interrupts()


def half_a_video(command, **rest):
    Path(command[-1]).write_bytes(b"half a vi")
    interrupts()


@pytest.mark.parametrize(
    ("name", "target", "stop"),
    [
        ("run.gif", "dimersweep.plots.movie._rendered", two_frames),
        ("run.mp4", "dimersweep.plots.movie.subprocess.run", half_a_video),
        ("run.html", "dimersweep.storage.files.sync", interrupts),
        ("run.pdf", "matplotlib.backends.backend_pdf.PdfFile.finalize", interrupts),
        ("run.nc", "dimersweep.storage.files.sync", interrupts),
    ],
)
def test_an_interruption_leaves_the_former_file(run, tmp_path, monkeypatch, name, target, stop):
    monkeypatch.setattr(movie, "_ffmpeg", lambda: "ffmpeg")
    path = tmp_path / name
    path.write_text("the former one")
    write = {".nc": run.save, ".pdf": run.plot}.get(path.suffix, partial(run.animate, periods=1))
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(target, stop)
        write(path, force=True)
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {name: "the former one"}


def test_simulate_makes_a_movie_and_keeps_the_run(empty_folder, call):
    assert call("simulate", "--periods", "1", "--movie", "a.gif", "--save", "a.nc")[2] == 0
    assert sorted(path.name for path in empty_folder.iterdir()) == ["a.gif", "a.nc"]


@needs_chromium
def test_the_page_plays_in_a_browser_without_a_network(browser, run, tmp_path):
    page_file = run.animate(tmp_path / "run.html", periods=3, fps=20)
    text = page_file.read_text(encoding="utf-8")
    assert len(text) < 1e5
    assert not re.findall(r"<(?:script|link)[^>]*(?:src|href)=\"(?!data:)", text)
    with chromium_page(browser, offline=True) as (page, errors):
        page.goto(page_file.as_uri())
        page.wait_for_function("document.querySelector('#now').textContent !== ''")
        page.evaluate(
            "() => { window.seen = []; const paint = views[0].draw;"
            " views[0].draw = function () { paint.call(this); seen.push([this.frame, performance.now()]); }; }"
        )
        page.wait_for_function(  # it begins again
            "() => seen.some(([frame], k) => k && frame < seen[k - 1][0]) && seen.at(-1)[0] > 20"
        )
        frames, at = np.array(page.evaluate("() => seen")).T
        frames = frames + 40 * np.cumsum(np.diff(frames, prepend=frames[0]) < 0)
        # however slowly the machine draws, each frame is shown at its time or is left out
        np.testing.assert_allclose(np.diff(at[[0, -1]]), 1000 * (frames[-1] - frames[0]) / 20, atol=700)
        page.get_by_text("pause", exact=True).click()
        before = page.screenshot()
        found = colors_of(before)
        assert found.get((3, 0, 0), 0) + found.get((2, 0, 0), 0) > 100  # p1 is red
        assert sum(count for (r, g, b), count in found.items() if b > r and b >= 2) > 1000  # the plate is blue
        page.locator("body").press("ArrowRight")
        page.locator("body").press("ArrowRight")
        assert page.screenshot() != before
        assert page.locator("footer").bounding_box()["height"] < 50  # its labels are whole, in one line
        filled = page.locator(".pictures").bounding_box()
        assert filled["height"] > 500 and page.evaluate("document.documentElement.scrollHeight") == 800
        page.set_viewport_size({"width": 390, "height": 800})  # a telephone's
        page.wait_for_function("document.documentElement.scrollWidth == 390")
        assert errors == []


@needs_chromium
def test_in_a_page_the_higher_ball_is_drawn_above_the_lower_one(browser, tmp_path):
    page_file = simulate(beta0="40 deg", xdot0=0.0, periods=2).animate(tmp_path / "run.html", periods=1, fps=5)
    with chromium_page(browser, offline=True) as (page, errors):
        page.add_init_script(
            "window.discs = []; const kind = CanvasRenderingContext2D.prototype, arc = kind.arc;"
            "kind.arc = function (x, y, ...rest) { discs.push([x, y]); return arc.call(this, x, y, ...rest); };"
        )
        page.goto(page_file.as_uri())
        page.wait_for_function("discs.length >= 2")
        (_, low), (_, high) = sorted(page.evaluate("discs.slice(0, 2)"))  # p2 is to the right
        first = page.evaluate("views[0].data.balls[0]")
        assert first[5] - first[2] > 5  # mm
        assert low > high  # pixels count downward
        assert errors == []


def test_a_rolling_ball_turns_with_its_marks():
    """Where both ends stick and roll on, what is on a ball at its lowest point stands still on the plate."""
    run = simulate(beta0="10 deg", periods=60)
    assert run.mode == "rest" and run.end_speed > 0.5
    shown = playing.frames(run, playing.Playback(3.0, 3.002, 1.0, 10_000, False))
    axis = np.diff(shown.balls, axis=1)[:, 0]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    body = np.stack([axis, shown.mark, np.cross(axis, shown.mark)], axis=2)  # columns that turn with it
    np.testing.assert_allclose(
        np.einsum("kij,kil->kjl", body, body), np.broadcast_to(np.eye(3), body.shape), atol=1e-12
    )
    turned = Rotation.from_matrix(body[2:] @ np.transpose(body[:-2], (0, 2, 1))).as_rotvec() / 2e-4  # rad/s
    moved = (shown.balls[2:] - shown.balls[:-2]) / 2e-4
    for end, r in enumerate(shown.radii):
        lowest = moved[:, end] + np.cross(turned, [0, 0, -r])
        assert np.abs(moved[:, end, :2]).max() > 500  # mm/s
        np.testing.assert_allclose(lowest[:, :2], 0, atol=0.5)


def test_a_page_shows_the_plate_as_it_tilts_and_moves():
    """The dimer falls by what the plate does, and a plate that moves by A sin(phase) carries its corners along."""
    tilt, azimuth, Gamma_x = 0.2, 0.7, 0.5
    run = simulate(tilt=tilt, azimuth=azimuth, Gamma_x=Gamma_x, periods=20)
    shown = playing.frames(run, playing.playback_of(run, 2, fps=10))
    uphill, downhill = np.array([[0.0, 0.0, 0.0], [np.cos(azimuth), np.sin(azimuth), 0.0]])
    places = shown.room.apply([uphill, downhill, [-np.sin(azimuth), np.cos(azimuth), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(places[:, 2], [0, -np.sin(tilt), 0, np.cos(tilt)], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(places[1:], axis=1), 1)
    np.testing.assert_allclose(np.cross(places[1], places[2]), places[3], atol=1e-15)
    amplitude = Gamma_x * run.parameters["g"] / (2 * np.pi * run.parameters["f"]) ** 2
    phase = run.states(shown.cycles / run.parameters["f"])["phase"]
    np.testing.assert_allclose(shown.away[:, 0], 1e3 * amplitude * np.sin(phase), atol=1e-9)
    assert not shown.away[:, 1:].any()


def test_a_page_of_a_small_dimer_is_as_round_as_that_of_a_large_one():
    """The same motion in other units: of length by 1e-3, and of time so that g stays."""
    large = simulate(periods=4)
    small = simulate(periods=4, r=5e-6, D_r=4e-6, f=15 * 1e3**0.5, xdot0=1e-3**0.5)
    pages = [view.seen(run, playing.playback_of(run, 2, 0.1 * s**0.5)) for run, s in ((large, 1), (small, 1e-3))]
    for name in ("balls", "plate", "radii"):
        np.testing.assert_allclose(pages[0][name], 1e3 * np.array(pages[1][name]), atol=1.01e-2)


def test_a_run_that_shows_nothing_is_told_so(run, tmp_path):
    none = replace(run, n_periods=0)
    for name, show in (("animate", lambda: none.animate(tmp_path / "run.gif")), ("view", none.view)):
        with pytest.raises(ParameterError, match=rf"^{name}: there is nothing to show, the run ended before a forcing"):
            show()


@pytest.mark.parametrize(("azimuth", "sense"), [("90 deg", 1), ("-90 deg", -1)])
def test_a_plate_that_falls_ahead_of_the_dimer_leans_down_to_the_right(tmp_path, azimuth, sense):
    """The axis points along Y, which is to the right as it is seen from the side; up is up."""
    run = simulate(tilt=0.25, azimuth=azimuth, Gamma=0.0, xdot0=0.0, mu=0.9, mu_s=1.0, beta0=0.0, periods=2)
    run.animate(tmp_path / "tilted.gif", periods=1, fps=5)
    with Image.open(tmp_path / "tilted.gif") as movie:
        picture = np.asarray(movie.convert("RGB"), float)
    picture = picture[:, : int(0.55 * picture.shape[1])]  # from the side
    blue = np.abs(picture - [0x56, 0xB4, 0xE9]).max(axis=2) < 40
    rows, columns = np.nonzero(blue)
    slope = np.polyfit(columns, rows, 1)[0]  # rows count downward
    assert rows.size > 200 and slope == pytest.approx(sense * np.tan(0.25), rel=0.2)

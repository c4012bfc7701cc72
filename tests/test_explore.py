"""A map to click: what a click shows, and the page in a real browser."""

import asyncio
import logging
import os
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager
from socket import create_server

import numpy as np
import pytest

import dimersweep
from dimersweep.errors import ParameterError, StoreError
from dimersweep.exploring import serving
from tests.browser import chromium_page, colors_of, needs_chromium

board = pytest.importorskip("dimersweep.exploring.board", reason="panel is not installed", exc_type=ImportError)
pytestmark = pytest.mark.jit
DEG = np.pi / 180


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("explore") / "cube.nc"


@pytest.fixture(scope="module")
def cube(file):
    return dimersweep.sweep(
        {"f": [15, 20], "Gamma": [0.8, 0.9], "beta0": {"start": 8, "stop": 24, "step": 4, "unit": "deg"}},
        periods=150,
        progress=False,
        out=file,
        attrs={"title": "some starts"},
    )


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    points = {"f": [15.0, 16.0, 20.0], "Gamma": [0.8, 0.91, 1.1], "beta0": [0.1, 0.27, 0.5]}
    out = tmp_path_factory.mktemp("points") / "points.nc"
    return dimersweep.sweep(points=points, periods=60, progress=False, out=out)


def test_a_click_shows_the_run_behind_the_nearest_point(cube):
    shown = board.Board(cube)
    run = shown.click(16.9, 0.88)  # in degrees, as the map is drawn
    assert run.parameters["Gamma"] == 0.9
    assert run.parameters["beta0"] == pytest.approx(16 * DEG)
    assert run.parameters["f"] == 15
    assert shown.spot.data == {"x": [pytest.approx(16)], "y": [0.9]}
    assert "drift" in shown.summary.object
    point = cube.sel(f=15, Gamma=0.9, beta0=16 * DEG, method="nearest")
    assert (run.n_periods, run.n_events) == (point["n_periods"], point["n_events"])
    assert run.n_periods < board.SHOWN_PERIODS
    heights = shown.picture.object.axes[0]
    assert len(shown.picture.object.axes) == 5
    assert max(line.get_xdata().max() for line in heights.lines) > run.n_periods


def test_a_slider_moves_the_map_and_the_run(cube):
    shown = board.Board(cube)
    before = list(shown.source.data["mode"])
    shown.sliders["f"].value = 1
    words = dimersweep.names(cube["mode"]).sel(f=20).values.ravel()
    assert list(shown.source.data["mode"]) == list(words)
    assert shown.click(16, 0.9).parameters["f"] == 20
    assert before == list(dimersweep.names(cube["mode"]).sel(f=15).values.ravel())


def test_angles_are_in_degrees_wherever_they_are_shown(cube):
    shown = board.Board(cube.transpose("beta0", "f", "Gamma"))
    assert list(shown.sliders["beta0"].options) == ["8", "12", "16", "20", "24"]
    assert shown.sliders["beta0"].label == "β(0) [°]"
    shown = board.Board(cube)
    np.testing.assert_allclose(shown.source.data["x"].reshape(2, 5), [[8, 12, 16, 20, 24]] * 2)
    np.testing.assert_allclose(shown.source.data["left"].reshape(2, 5)[0], [6, 10, 14, 18, 22])
    assert shown.map.xaxis[0].axis_label == "β(0) [°]"
    assert "5 values from 8° to 24°" in cube.dimersweep._repr_html_()


def test_values_that_differ_late_are_told_apart(cube):
    pair = cube.isel(f=[0, 0]).assign_coords(f=[0.6, 0.6000001])
    assert board.Board(pair).sliders["f"].options == {"0.6": 0, "0.6000001": 1}
    assert board.distinct_labels(np.array([1 / 3, 1.0])) == ["0.33333", "1"]
    assert board.distinct_labels(np.array([1.0, np.nextafter(1, 2)])) == ["1", "1.0000000000000002"]


def test_modes_that_are_no_whole_numbers_are_refused(cube):
    with pytest.raises(StoreError, match=r"^mode: is of type float64, as where\(\) makes it"):
        board.Board(cube.assign(mode=cube["mode"].astype(float)))


def test_a_quantity_is_shown_in_shades(cube):
    shown = board.Board(cube)
    (cells,) = shown.hover.renderers
    assert cells.glyph.fill_color == "color"
    shown.quantity.value = "radius"
    assert (cells.glyph.fill_color.field, cells.glyph.fill_color.transform) == ("shown", shown.mapper)
    ends = cube["radius"].min(), cube["radius"].max()  # of the whole cube
    assert (shown.mapper.low, shown.mapper.high, shown.mapper.nan_color) == (*ends, "#ffffff")
    assert shown.bar.visible and shown.bar.title == "radius [m]" and not shown.key.visible
    told = dict(shown.hover.tooltips)
    assert list(told) == ["β(0) [°]", "Γ", "mode", "radius [m]"]
    np.testing.assert_array_equal(shown.source.data["shown"], cube["radius"].sel(f=15).values.ravel())
    assert shown.spot not in [renderer.data_source for renderer in shown.hover.renderers]


def test_points_that_are_no_grid_are_shown_over_any_two_of_their_parameters(sample):
    shown = board.Board(sample)
    np.testing.assert_array_equal(shown.source.data["x"], np.rad2deg(sample["beta0"]))
    np.testing.assert_array_equal(shown.source.data["y"], sample["f"])
    run = shown.click(16.0, 15.9)
    assert (run.parameters["beta0"], run.parameters["Gamma"], run.parameters["f"]) == (0.27, 0.91, 16.0)
    assert shown.spot.data == {"x": [np.rad2deg(0.27)], "y": [16.0]}
    shown.choices["up"].value = "Gamma"
    assert shown.spot.data["x"] == []
    np.testing.assert_array_equal(shown.source.data["y"], sample["Gamma"])
    assert shown.map.yaxis[0].axis_label == "Γ"
    assert shown.click(6, 0.9).parameters["f"] == 15.0


def test_a_cube_over_one_axis_and_a_search_are_shown(cube):
    assert board.Board(cube.isel(f=0, Gamma=1)).click(16, 0.3).mode == "drift"
    found = dimersweep.search(
        {"f": [15, 20], "beta0": [0.05, 0.28]}, over="beta0", ask="first", periods=100, progress=False
    )
    assert board.Board(found).click(15, 0.5).parameters["f"] == 15


def test_a_cube_without_axes_is_refused(cube):
    with pytest.raises(ParameterError, match=r"^explore: needs a cube over at least one axis of more than one value$"):
        dimersweep.explore(cube.isel(f=0, Gamma=0, beta0=0))
    with pytest.raises(ParameterError, match=r"^explore: needs a cube over at least one axis"):
        dimersweep.explore(cube.isel(f=slice(0, 0)))
    with pytest.raises(ParameterError, match=r"^explore: str is no cube; give one of sweep, or of open_cube\(path\)$"):
        dimersweep.explore("cube.nc")


def test_without_panel_it_says_what_to_install(cube, monkeypatch):
    monkeypatch.setitem(sys.modules, "panel", None)
    with pytest.raises(StoreError, match=r"^explore: needs panel; pip install 'dimersweep\[explore\]'$"):
        dimersweep.explore(cube)


def test_a_cube_that_is_none_is_refused_before_a_server_starts(call):
    assert call("explore", "absent.nc")[1:] == ("dimersweep: error: absent.nc: no such file\n", 2)


def test_a_page_that_is_closed_while_it_draws_leaves_no_traceback(cube, monkeypatch, caplog):
    """Bokeh sends on to the page; asyncio tells of that at length. Whatever else goes wrong is told."""
    panel = pytest.importorskip("panel")
    websocket = pytest.importorskip("tornado.websocket")

    def serves(*rest, **more):
        loop = asyncio.new_event_loop()
        for error in (websocket.WebSocketClosedError(), ValueError("a fault")):
            loop.call_exception_handler({"message": "Task exception was never retrieved", "exception": error})
        loop.close()
        logging.getLogger("bokeh.server.views.ws").warning("Failed sending message as connection was closed")

    monkeypatch.setattr(panel, "serve", serves)
    with pytest.raises(KeyboardInterrupt):
        serving.serve(cube, port=0, show=False)
    assert [record.exc_info[0] for record in caplog.records] == [ValueError]


@contextmanager
def served(path):
    """The address of a server for the cube at `path`."""
    with create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    command = [sys.executable, "-m", "dimersweep", "explore", str(path), "--no-show", "--port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            address, give_up = f"http://127.0.0.1:{port}/", time.monotonic() + 90
            while True:
                try:
                    with urllib.request.urlopen(address, timeout=60):
                        break
                except OSError:
                    assert process.poll() is None and time.monotonic() < give_up
                    time.sleep(0.2)
            yield address
        finally:
            process.terminate()


MARKUP = '<img src=x onerror="window.hit=1"><script>window.hit=1</script> *a* [b](javascript:alert) $c$ & d'


@needs_chromium
def test_markup_in_a_cube_is_shown_as_it_is_written(cube, tmp_path):
    word = MARKUP.replace(" ", "/")
    held = cube.copy()
    held["mode"].attrs["flag_meanings"] = " ".join([word] * len(cube["mode"].attrs["flag_values"]))
    name = "v" + MARKUP.replace("/", "")
    held[name] = held["radius"]
    held.attrs["title"] = MARKUP
    file = tmp_path / "cube.nc"
    held.to_netcdf(file)
    with served(file) as address, chromium_page(offline=False, width=1300, height=900) as (page, errors):
        page.goto(address)
        page.get_by_text("Click a point of the map").wait_for(timeout=60_000)
        assert page.locator("h3").inner_text() == MARKUP
        place = page.locator(".bk-Canvas").first.bounding_box()
        page.mouse.move(place["x"] + 0.5 * place["width"], place["y"] + 0.5 * place["height"])
        page.get_by_text(word).first.wait_for(timeout=30_000)  # beside the pointer
        page.get_by_label("shown").select_option(name)
        page.wait_for_timeout(1000)
        if os.environ.get("DIMERSWEEP_SCREENSHOTS"):
            page.screenshot(path=f"{os.environ['DIMERSWEEP_SCREENSHOTS']}/markup.png")
        assert page.evaluate("window.hit") is None
        assert page.locator("img[src=x]").count() == 0
        assert [each for each in errors if "favicon" not in each] == []


@pytest.mark.slow
@needs_chromium
def test_a_click_in_a_browser_changes_the_run(cube, file):
    with served(file) as address, chromium_page(offline=False, width=1300, height=900) as (page, errors):
        page.on("request", lambda request: errors.append(request.url) if "127.0.0.1" not in request.url else None)
        page.goto(address)
        page.get_by_text("Click a point of the map").wait_for(timeout=60_000)
        place = page.locator(".bk-Canvas").first.bounding_box()
        assert colors_of(page.screenshot())  # the map is drawn
        for right, told in ((0.85, "24°"), (0.25, "8°")):
            page.mouse.click(place["x"] + right * place["width"], place["y"] + 0.25 * place["height"])
            page.get_by_text("centre of mass").or_(page.get_by_text("Run:")).first.wait_for(timeout=30_000)
            page.get_by_text(f"β(0) = {told}").wait_for(timeout=30_000)
        page.get_by_role("img").or_(page.locator(".bk-panel-models-layout-Column img, svg")).last.wait_for(
            timeout=30_000
        )
        page.wait_for_timeout(3000)
        assert page.get_by_text("mode:").first.is_visible()
        assert page.get_by_text("???").count() == 0
        page.set_viewport_size({"width": 390, "height": 800})  # a telephone's: the run is below the map
        page.wait_for_timeout(1000)
        picture = page.locator("img[src^='data:image/svg'], .bk-panel-models-layout-Column svg").last.bounding_box()
        assert picture["width"] > 250 and picture["x"] >= 0 and picture["x"] + picture["width"] <= 390
        page.get_by_role("button", name="replay").click()
        page.frame_locator("iframe").get_by_text("forcing period").first.wait_for(timeout=60_000)
        assert page.locator("iframe").bounding_box()["height"] > 500
        if os.environ.get("DIMERSWEEP_SCREENSHOTS"):
            page.screenshot(path=f"{os.environ['DIMERSWEEP_SCREENSHOTS']}/explore.png")
        assert [each for each in errors if "favicon" not in each] == []

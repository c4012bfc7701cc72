"""The page with the moving dimer: what it is answered, and a session of it in a real browser."""

import http.client
import json
import os
import re
import shlex
import subprocess
import sys
import urllib.request
from contextlib import closing, contextmanager
from html import escape
from socket import create_server

import numpy as np
import pytest

import dimersweep
from dimersweep import orbits
from dimersweep.errors import ParameterError, StoreError
from dimersweep.exploring.mapping import MOST_CELLS, CubeMap
from dimersweep.exploring.page import LivePage
from dimersweep.exploring.serving import USUAL_PORT, Explorer
from dimersweep.parameters import Parameters, completed
from dimersweep.plots.style import MODE_COLORS
from dimersweep.symbols import MODE_MEANINGS, is_angle, stated
from tests.browser import chromium_page, colors_of, needs_chromium, watched

pytestmark = pytest.mark.jit
DEG = np.pi / 180


@pytest.fixture(scope="module")
def cube():
    return dimersweep.sweep(
        {"f": [15, 20], "Gamma": [0.8, 0.9], "beta0": {"start": 8, "stop": 24, "step": 4, "unit": "deg"}},
        periods=150,
        progress=False,
        attrs={"title": "some starts"},
    )


@pytest.fixture(scope="module")
def sample():
    points = {"f": [15.0, 16.0, 20.0], "Gamma": [0.8, 0.91, 1.1], "beta0": [0.1, 0.27, 0.5]}
    return dimersweep.sweep(points=points, periods=60, progress=False)


def test_a_map_tells_what_its_points_share(cube, sample):
    held = CubeMap(cube).part({"f": "1"})["held"]
    assert held["f"] == "20" and held["e"] == held["e_2"] == "0.6" and "Gamma" not in held and "beta0" not in held
    assert {"f", "Gamma", "beta0"}.isdisjoint(CubeMap(sample).part({})["held"])
    branch = LivePage(orbits.follow(orbits.find(spin=100.0, f=20.0), "Gamma", to=0.85)).map.part({})
    assert branch["held"]["f"] == "20" and {"Gamma", "beta0", "xdot0"}.isdisjoint(branch["held"])


# --- what the page is answered ----------------------------------------------------------------------------------------
def test_a_run_is_told_as_it_is_drawn():
    told = json.loads(json.dumps(LivePage().run({"Gamma": "1.1", "beta0": "20 deg", "shown": "start", "stretch": "2"})))
    run = dimersweep.simulate(Gamma=1.1, beta0="20 deg", periods=200, stop_when_settled=True)
    assert (told["mode"], told["color"]) == (run.mode, MODE_COLORS[run.mode])
    assert told["says"] == f"{MODE_MEANINGS[run.mode]} (docs/motions.md)"
    assert told["numbers"][0] == ["periods", f"{run.n_periods} of 0.06667 s"]
    assert told["given"] == {"Gamma": "1.1", "beta0": "20"}
    assert len(told["cycles"]) == 200 and told["pace"] == 1500
    states = run.states(np.array(told["cycles"]) / 15)
    balls = np.array(told["balls"])
    np.testing.assert_allclose(balls[:, :3].T, [1e3 * states[name] for name in ("x1", "y1", "z1")], atol=2e-2)
    np.testing.assert_allclose(balls[:, 5] - 5, 1e3 * (states["gap_2"] + states["plate"]), atol=2e-2)
    np.testing.assert_allclose(told["plate"], 1e3 * states["plate"], atol=1e-2)
    np.testing.assert_allclose(told["track"][-1], 1e3 * run.states(run.duration)[["x", "y"]].to_array(), atol=1e-2)


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        ({"f": "900 rpm", "r": "4 mm", "D_r": "3000um", "Gamma": "90 %"}, {"f": 15, "r": 4e-3, "D_r": 3e-3}),
        ({"f": "0.022kHz", "xdot0": "50 cm/s", "gap0": "0.1 mm"}, {"f": 22, "xdot0": 0.5, "gap0": 1e-4}),
        ({"beta0": "0.3 rad", "phi0": "−90"}, {"beta0": 0.3, "phi0": "-90 deg"}),
        ({"beta0": "20", "tilt": "0.02rad", "theta0": "1e-1"}, {"beta0": "20 deg", "tilt": 0.02, "theta0": "0.1 deg"}),
        ({"beta0": "18°", "gammadot0": "600 rpm"}, {"beta0": "18 deg", "gammadot0": 20 * np.pi}),
        ({"A_z": "500um"}, {"A_z": 5e-4}),
        ({"A_z": "0.5"}, {"A_z": 5e-4}),  # the field is in mm
        ({"v_z": "80 mm/s", "l": "6 cm"}, {"v_z": 0.08, "l": 0.06}),
        ({"l": "60", "g": "1 gn", "rho_b": "7.8 g/cm^3"}, {"l": 0.06, "g": 9.80665, "rho_b": 7800}),
        ({"Gamma_2": "0.2", "phi_2": "45", "Gamma_x_3": "0.1"}, {"Gamma_2": 0.2, "phi_2": "45 deg", "Gamma_x_3": 0.1}),
    ],
)
def test_a_field_takes_a_unit_and_a_bare_number_has_that_of_the_field(asked, given):
    told = LivePage().run(asked | {"periods": "5"})
    known = completed(Parameters(**given).given())
    assert {name: float(text) for name, text in told["place"].items() if name in known} == pytest.approx(
        {name: value / DEG if is_angle(name) else value for name, value in known.items()}, rel=1e-11
    )
    amplitude = known["Gamma"] * known["g"] / (2 * np.pi * known["f"]) ** 2
    others = {
        "A_z": 1e3 * amplitude,
        "v_z": amplitude * 2 * np.pi * known["f"],
        "l": 1e4 * known["r"] * (known["A_r"] - 1) / 5,
    }
    assert {name: float(told["place"][name]) for name in others} == pytest.approx(others, rel=1e-11)


@pytest.mark.parametrize(
    ("asked", "wrong"),
    [
        ({"f": "15 m"}, ["f = '15 m': the unit must be Hz, rpm or the like"]),
        ({"r": "4 kg", "beta0": "5 mm"}, ["r = '4 kg': the unit must", "beta0 = '5 mm': the unit must"]),
        (
            {"Gamma": "0,9", "e": "half"},
            ["Gamma = '0,9': has a decimal comma; give 0.9", "e = 'half': must be a number"],
        ),
        (
            {"e": "2", "mu": "0.5", "D_r": "2 cm"},
            ["e = 2.0: must be in", "mu_s = 0.4: must be >= mu", "D_r = 0.02: must"],
        ),
        ({"mu": "x", "mu_s": "0.1"}, ["mu = 'x': must be a number"]),  # beside which mu_s is not judged
        ({"e": "-1", "l": "1 mm"}, ["e = -1.0: must be in", "l = 0.001: must be >= r_1 + r_2"]),
        ({"A_z": "1", "Gamma": "2", "f": "0"}, ["f = 0.0: must be > 0", "A_z: given together with Gamma"]),
        ({"A_z": "-1"}, ["A_z = -0.001: must be >= 0"]),
        ({"e": "0.5", "e_1": "0.5", "e_2": "0.5"}, ["e: has no effect beside e_1 and e_2"]),
        (
            {"periods": "2.5", "rtol": "1", "stretch": "0"},
            ["stretch = 0: must", "periods = '2.5': must", "rtol = 1.0: must"],
        ),
        (
            {"xdot0": "nan", "gap0": "inf", "g": "1e999"},
            ["xdot0 = nan: must be f", "gap0 = inf: must", "g = inf: must"],
        ),
        ({"gamma": "1"}, ["gamma: unknown parameter; did you mean Gamma?"]),
        ({"harmonics": "plate.toml"}, ["harmonics: are for single runs"]),
        ({"shown": "middle", "f": "0"}, ["shown = middle: must be one of start, end", "f = 0.0: must be > 0"]),
        ({"at": "0,1"}, ["at = 0,1: is a point of a map, and this page has none"]),
    ],
)
def test_each_field_at_fault_is_named_in_a_line(asked, wrong):
    with pytest.raises(ParameterError) as told:
        LivePage().run(asked)
    lines = str(told.value).split("\n")
    assert [line[: len(start)] for line, start in zip(lines, wrong, strict=True)] == wrong


def test_a_size_that_is_not_usual_is_told():
    with pytest.warns(RuntimeWarning, match=r"r = 4: at most 0.1 m is usual"):
        told = LivePage().run({"r": "4", "D_r": "1", "periods": "2"})
    assert told["unusual"] == ["r = 4: at most 0.1 m is usual; is it in SI units?"]


def test_of_a_long_stretch_as_many_frames_are_told_as_a_page_takes():
    told = LivePage().run({"stretch": "40", "periods": "50", "Gamma": "2.5"})
    assert len(told["balls"]) == 2000 and told["cycles"][0] == 10


def test_a_slow_run_is_stopped_and_told_of(monkeypatch):
    monkeypatch.setattr("dimersweep.exploring.page.SECONDS", 0.02)
    told = LivePage().run({"Gamma": "2.5", "periods": "100000"})
    assert told["mode"] == "failed" and told["says"].endswith("its time was up)")


def same(one, other):
    assert (one.mode, one.n_periods, one.n_events) == (other.mode, other.n_periods, other.n_events)
    assert (Parameters(**one.parameters).row() == Parameters(**other.parameters).row()).all()


def made_by(code):
    """The run that a copied text makes, in a process that has no name before."""
    known = {}
    exec(code, known)
    return known["run"]


def seen_in(output):
    """The mode, and the numbers with their units, that a copied text has printed."""
    mode = re.search(r"<Run: \w+, (\w+)", output)[1]
    counts = {name: re.search(rf"(\d+) {name}", output)[1] for name in ("periods", "events")}
    orbit = re.search(r"<Orbit: (.*), di_end", output)
    named = (each.partition(" ")[::2] for each in (orbit[1].split(", ") if orbit else ()))
    return mode, counts | {name.replace("_", " "): text for name, text in named if name != "spin"}


COPIED = [
    {},
    {"f": "900 rpm", "r": "4 mm", "A_r": "5.75", "e": "63 %"},
    {"beta0": "0.3 rad", "xdot0": "-50 cm/s", "phi0": "33.3"},
    {"Gamma_2": "0.2", "phi_2": "45", "Gamma_3": "0.1", "phi_x_2": "1 rad", "Gamma_x_2": "0.01"},
    {"A_z": "1.03", "f": "15.3"},
    {"v_z": "95 mm/s", "mu_s": "0.5"},
    {"l": "5.5 cm", "D_r": "3000 um"},
    {"e_1": "0.5", "e_2": "0.62", "r_1": "5.1 mm", "mu_2": "0.21", "rho_b_1": "7.8 g/cm^3"},
    {"tilt": "0.5", "azimuth": "90", "gap0": "0.1 mm"},
    {"Gamma": "2.5", "periods": "30", "rtol": "1e-10"},
]


def test_what_is_copied_runs_as_it_stands_and_gives_the_numbers_of_the_page(call, cube):
    """All in a fresh process, one after the other; and as the commands are typed."""
    pages = [LivePage().run(asked) for asked in COPIED] + [LivePage(cube).run({"at": "1,1,2"})]
    apart = "print('=' * 9)\n"
    done = subprocess.run(
        [sys.executable, "-"],
        input=apart.join(told["copy"]["Python"] for told in pages),
        capture_output=True,
        check=True,
        text=True,
    )
    assert done.stderr == ""
    for told, printed in zip(pages, done.stdout.split("=" * 9 + "\n"), strict=True):
        mode, numbers = seen_in(printed)
        shown = dict(told["numbers"])
        assert mode == told["mode"].split(",")[0]
        assert numbers == {"periods": shown["periods"].split()[0]} | {
            name: text.replace("none: straight", "none").strip()
            for name, text in shown.items()
            if name in numbers and name != "periods"
        }
        assert mode != "drift" or {"radius", "period", "zeta", "speed", "impact phase"} < {*numbers}
        out, _, code = call(*shlex.split(told["copy"]["command"])[1:], "--json")
        found = json.loads(out)
        assert (code, found["mode"], str(found["n_events"])) == (0, mode, shown["events"])
        words = {
            name for name in (found["track"], *([found["orbit"]["di_end"]] if found["orbit"] else [])) if name != "none"
        }
        assert words < {*shown}
        for name in ("radius", "path_radius", "zeta", "speed") if found["orbit"] else ():
            value = found["orbit"][name]
            assert shown[name.replace("_", " ")].split()[0] == f"{value:.6g}"


def test_what_is_copied_makes_the_run_again(call, empty_folder):
    asked = {"Gamma": "1.1", "beta0": "20.5 deg", "e_1": "0.5", "tilt": "0.03 rad", "xdot0": "-0.5"}
    copied = LivePage().run(asked)["copy"]
    run = dimersweep.simulate(
        Gamma=1.1, beta0="20.5 deg", e_1=0.5, tilt=0.03, xdot0=-0.5, periods=200, stop_when_settled=True
    )
    assert "beta0='20.5 deg'" in copied["Python"] and "--beta0 20.5deg" in copied["command"]
    same(made_by(copied["Python"]), run)
    out, _, code = call(*copied["command"].split()[1:], "--json")
    whole = json.loads(out[out.index("{") :])
    assert code == 0 and whole["mode"] == run.mode
    assert whole["parameters"] == stated(run.parameters)
    (empty_folder / "point.toml").write_text(copied["TOML"])
    assert call("run", "point.toml", "--no-plot")[2] == 0
    same(dimersweep.open_cube("point.nc").isel(Gamma=0).dimersweep.run(), run)


def test_a_click_shows_the_run_behind_the_point(cube):
    page = LivePage(cube)
    told = page.run({"at": "1,1,2", "Gamma": "0.3"})  # the point is in place of all else
    run = cube.dimersweep.run(f=20, Gamma=0.9, beta0="16 deg")
    assert told["given"] == {"f": "20"}  # which is all but the base case
    assert told["numbers"][:2] == [("periods", f"{run.n_periods} of 0.05 s"), ("events", f"{run.n_events}")]
    same(made_by(told["copy"]["Python"]), run)
    assert told["settings"] == {"periods": "150", "rtol": "1e-08"}
    assert told["place"]["beta0"] == "16"


def test_a_carried_state_is_copied_with_the_run():
    both = dimersweep.sweep({"Gamma": [0.9, 1.0, 1.1]}, periods=60, carry="both", progress=False)
    page = LivePage(both)
    places = dict.fromkeys(page.map.dims, "0") | {"direction": "1", "Gamma": "0"}
    copied = page.run({"at": ",".join(places[name] for name in page.map.dims)})["copy"]
    assert list(copied) == ["Python"]
    again = made_by(copied["Python"])
    assert again.mode == both.dimersweep.run(Gamma=0.9, direction="down").mode
    assert again.start["theta"] != 0


def test_the_map_shows_the_part_that_is_asked_for(cube):
    shown = CubeMap(cube.transpose("Gamma", "f", "beta0"))
    told = shown.description()
    assert (told["dims"], told["fixed"]) == (
        ["Gamma", "f", "beta0"],
        {"Gamma": {"label": "Γ", "values": ["0.8", "0.9"]}},
    )
    part = shown.part({"Gamma": "1"})
    words = dimersweep.names(cube["mode"]).sel(Gamma=0.9).values.ravel()
    assert part["modes"] == words.tolist()
    assert part["colors"] == [MODE_COLORS[word] for word in words]
    assert (part["x"]["label"], part["y"]["label"]) == ("β(0) [°]", "f [Hz]")
    np.testing.assert_allclose(part["x"]["edges"], [6, 10, 14, 18, 22, 26])
    assert [color for color, _ in part["key"]] == [MODE_COLORS[w] for w in MODE_COLORS if w in cube.dimersweep.modes()]


def test_borders_and_branches_have_a_map():
    curve = orbits.border("fold", "Gamma", over={"e": [0.55, 0.6]}, spin=100.0)
    page = LivePage(curve)
    assert page.map.description()["sides"] == {"e": "e", "Gamma": "Γ"}
    part = page.map.part({})
    assert part["modes"] == ["fold", "fold"]
    assert part["key"] == [[orbits.BORDER_KINDS["fold"].color, "fold"]]
    assert part["y"]["at"] == curve["Gamma"].values.tolist()
    told = page.run({"at": "1"})
    assert (told["place"]["e"], float(told["place"]["Gamma"])) == ("0.6", pytest.approx(curve["Gamma"][1].item()))
    branch = LivePage(orbits.follow(orbits.find(spin=100.0), "Gamma", to=0.7)).map.part({})
    assert {*branch["modes"]} == {"stable", "unstable"}
    assert (branch["x"]["label"], branch["y"]["label"]) == ("Γ", "radius [m]")
    with pytest.raises(
        ParameterError, match=r"^explore: a table of orbits has no map; give borders or branches over a parameter$"
    ):
        LivePage(orbits.family(spin=(100.0, 110.0), points=3))
    with pytest.raises(
        ParameterError, match=r"^explore: a table along event is no cube; give one of sweep, or of open"
    ):
        LivePage(dimersweep.simulate(periods=1).events)


def test_a_quantity_is_shown_in_shades(cube):
    part = CubeMap(cube).part({"f": "0", "shown": "radius"})
    values = cube["radius"].sel(f=15).values.ravel()
    assert part["values"] == ["none" if np.isnan(value) else f"{value:.6g}" for value in values]
    assert "none" in part["values"]
    assert [color == "" for color in part["colors"]] == np.isnan(values).tolist()
    assert part["bar"]["ends"] == [f"{cube['radius'].min():.4g}", f"{cube['radius'].max():.4g}"]  # of the whole cube
    assert part["bar"]["label"] == "radius [m]"
    endless = CubeMap(cube.assign(radius=cube["radius"] * np.inf)).part({"shown": "radius"})
    assert (
        set(endless["values"]) == {"none"} and set(endless["colors"]) == {""} and endless["bar"]["ends"] == ["0", "1"]
    )
    brightness = [int(color[1:3], 16) + int(color[3:5], 16) for color in part["colors"] if color]
    assert np.argmax(brightness) == np.nanargmax(values[~np.isnan(values)])


def test_values_that_differ_late_are_told_apart(cube):
    pair = cube.isel(f=[0, 0]).assign_coords(f=[0.6, 0.6000001])
    assert CubeMap(pair).description()["fixed"]["f"]["values"] == ["0.6", "0.6000001"]


def test_points_that_are_no_grid_are_shown_over_any_two_of_their_parameters(sample):
    page = LivePage(sample)
    told = page.map.description()
    assert told["points"] and sorted(told["sides"]) == ["Gamma", "beta0", "f"]
    part = page.map.part({"right": "f", "up": "Gamma"})
    assert (part["x"]["at"], part["y"]["at"]) == ([15, 16, 20], [0.8, 0.91, 1.1])
    assert page.run({"at": "1"})["place"]["Gamma"] == "0.91"


def test_a_cube_over_one_axis_and_a_search_are_shown(cube):
    line = LivePage(cube.isel(f=0, Gamma=1))
    assert (line.map.part({})["y"]["name"], line.run({"at": "2"})["mode"]) == ("", "drift")
    found = dimersweep.search(
        {"f": [15, 20], "beta0": [0.05, 0.28]}, over="beta0", ask="first", periods=100, progress=False
    )
    assert LivePage(found).run({"at": "0"})["place"]["f"] == "15"


def test_cubes_that_cannot_be_shown_are_refused(cube):
    with pytest.raises(ParameterError, match=r"^explore: needs a cube over at least one axis of more than one value$"):
        dimersweep.explore(cube.isel(f=0, Gamma=0, beta0=0))
    with pytest.raises(ParameterError, match=r"^explore: needs a cube over at least one axis"):
        dimersweep.explore(cube.isel(f=slice(0, 0)))
    with pytest.raises(StoreError, match=r"^mode: is of type float64, as where\(\) makes it"):
        dimersweep.explore(cube.assign(mode=cube["mode"].astype(float)))
    wide = cube.isel(Gamma=[0] * 502, beta0=[0] * 502)
    with pytest.raises(ParameterError, match=rf"^explore: a map of more than {MOST_CELLS} cells; give a part"):
        dimersweep.explore(wide)


# --- the server -------------------------------------------------------------------------------------------------------
@contextmanager
def served(cube=None):
    """The address of a page."""
    explorer = Explorer(cube, 0)
    try:
        yield explorer.address
    finally:
        explorer.close()


def fetched(address, host=None):
    request = urllib.request.Request(address, headers={"Host": host} if host else {})
    with urllib.request.urlopen(request, timeout=60) as answer:
        return answer.read().decode()


def answered(address, method, path, **headers):
    """The status, the headers and the body of an answer, whatever they are; all that came after the headers is its body."""
    connection = http.client.HTTPConnection(*address.split("/")[2].split(":"), timeout=60)
    with closing(connection):
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read().decode()


def test_the_server_answers_this_machine_alone():
    """And no page of another site, whose name was made to lead here: its browser tells that name."""
    with served() as address:
        assert json.loads(fetched(f"{address}run?f=0")) == {"error": "f = 0.0: must be > 0"}
        for host in ("localhost:80", "LocalHost", "127.0.0.1:9000", "[::1]:8470"):
            assert "<canvas" in fetched(address, host), host
        others = (
            "evil.example",
            "127.0.0.1.evil.example:8470",
            "localhost.evil.example",
            "myhost:8470",
            "",
            "[",
            "\xe9" * 999,
        )
        for host in (*others, "<script>alert(1)</script>"):
            for path in ("/", "/run?f=15", "/etc"):
                code, _, told = answered(address, "GET", path, Host=host)
                assert code == 403 and "<canvas" not in told and "<script" not in told, (host, path)
                assert f'<a href="{address}">{address}</a>' in told
                assert f"ssh -N -L {address.split(':')[-1][:-1]}:127.0.0.1:" in told
                assert escape(host[:200]) in told


def test_a_path_or_a_method_that_the_server_does_not_have_is_told():
    with served() as address:
        for path in ("/map?shown=mode", "/etc", "/run/", "/../run", "/favicon.ico", "/http://[", "/<b>"):
            code, _, told = answered(address, "GET", path)
            assert code == 404 and "no such page" in told and "<b>" not in told, path
        for method in ("POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE"):
            code, headers, told = answered(address, method, "/run")
            assert (code, headers["Allow"], told) == (405, "GET, HEAD", f"{method}: must be GET or HEAD\n")


def test_head_answers_as_get_does_without_the_page():
    with served() as address:
        for path in ("/", "/run?f=0", "/etc", "/run?periods=5"):
            for host in ("127.0.0.1", "myhost"):
                got, head = (answered(address, method, path, Host=host) for method in ("GET", "HEAD"))
                assert head[0] == got[0] and head[2] == "", (path, host)
                assert {**head[1], "Date": ""} == {**got[1], "Date": ""}
                assert head[1]["Content-Length"] == str(len(got[2].encode()))


def test_a_port_that_is_taken_is_told_and_the_usual_one_gives_way():
    with create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(StoreError, match=rf"^port = {port}: cannot be served on \(Address already in use\)$"):
            Explorer(port=port)
    explorers = [Explorer(), Explorer()]
    ports = {explorer.address.split(":")[-1] for explorer in explorers}
    for explorer in explorers:
        explorer.close()
        explorer.wait()
    assert len(ports) == 2 and f"{USUAL_PORT}/" != explorers[1].address.split(":")[-1]


def test_a_cube_that_is_none_is_refused_before_a_server_starts(call):
    assert call("explore", "absent.nc")[1:] == ("dimersweep: error: absent.nc: no such file\n", 2)


# --- the page in a browser --------------------------------------------------------------------------------------------
def picture(page, name):
    if os.environ.get("DIMERSWEEP_SCREENSHOTS"):
        page.screenshot(path=f"{os.environ['DIMERSWEEP_SCREENSHOTS']}/{name}.png")


@pytest.fixture(scope="module")
def window(browser):
    """A page for several tests: one of its own would take each half a second more of processor time."""
    with chromium_page(browser, offline=False) as (page, _):
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        yield page


@contextmanager
def opened(window, cube=None, width=1280, height=860, *, plays=False):
    """The page when it has drawn its first run; it must leave no error behind.

    Unless it `plays`, its dimer stands still, as for a reader who asks for that: sixty frames a second take processor time.
    """

    def listen(request):
        if address not in request.url:
            errors.append(request.url)

    with served(cube) as address, watched(window) as errors:
        window.set_viewport_size({"width": width, "height": height})
        window.emulate_media(color_scheme="light", reduced_motion="no-preference" if plays else "reduce")
        window.mouse.move(0, 0)
        window.on("request", listen)
        try:
            window.goto(address)
            window.wait_for_function("document.body.dataset.drawn >= 1", timeout=90_000)
            yield window
            assert [each for each in errors if "blob:" not in each] == []
        finally:
            window.remove_listener("request", listen)
            for page in window.context.pages[1:]:
                page.close()
            window.goto("about:blank")


def drawn(page, do):
    """Do what changes the run, and wait for its picture."""
    before = page.evaluate("document.body.dataset.drawn")
    do()
    page.wait_for_function(f"document.body.dataset.drawn != {before}", timeout=30_000)


def told(page, which="mode", view=0):
    return page.locator(f".{which}").nth(view).inner_text()


SLIDE = """async (value) => {
  const slider = document.getElementById("slide-Gamma"), before = document.body.dataset.drawn, begun = performance.now();
  slider.value = value;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  while (document.body.dataset.drawn === before) await new Promise(requestAnimationFrame);
  await new Promise(requestAnimationFrame);  // the one after is painted
  return (performance.now() - begun) / 1000;
}"""


@needs_chromium
def test_a_slider_changes_the_picture_at_once(window):
    with opened(window) as page:
        seconds = [page.evaluate(SLIDE, 0.8 + 0.02 * k) for k in range(20)]
        print(f"\nfrom a slider to its picture: median {np.median(seconds):.3f} s, at most {max(seconds):.3f} s")
        assert "Γ = 1.18" in told(page, "conditions").replace("\xa0", " ")
        assert os.getloadavg()[0] > (os.cpu_count() or 1) or np.median(seconds) < 0.2  # a busy machine takes longer


@needs_chromium
def test_a_dimer_is_played_with(window):
    with opened(window, plays=True) as page:
        assert told(page) == "drift" and MODE_MEANINGS["drift"] in told(page, "says")
        assert page.locator("#play").inner_text() == "pause"  # it plays by itself
        first = page.locator("#now").inner_text()
        page.wait_for_function(f"document.querySelector('#now').textContent != {first!r}")
        page.locator("body").press("Space")
        assert page.locator("#play").inner_text() == "play"
        stopped = page.evaluate("[clock.at, views[0].frame]")
        page.locator("body").press("ArrowRight")
        assert page.evaluate("views[0].frame") == stopped[1] + 1
        # the amplitude is the intensity by another name, and the one that was given is held
        drawn(page, lambda: page.locator("#of-A_z").fill("0.5"))
        amplitude = 9810 / (2 * np.pi * 15) ** 2
        assert float(page.locator("#of-Gamma").input_value()) == pytest.approx(0.5 / amplitude, rel=1e-9)
        drawn(page, lambda: page.locator("#of-f").fill("30"))
        assert float(page.locator("#of-Gamma").input_value()) == pytest.approx(2 / amplitude, rel=1e-9)
        # space plays where a slider has the focus, and the arrows are the slider's own there
        page.locator("#slide-e").focus()
        page.keyboard.press("Space")
        assert page.locator("#play").inner_text() == "pause"
        drawn(page, lambda: page.keyboard.press("ArrowRight"))
        assert page.locator("#of-e").input_value() == "0.61" and page.locator("#play").inner_text() == "pause"
        # what cannot be is told in the line that Python has for it, and the picture stays
        page.locator("#of-e").fill("1.5")
        page.get_by_text("e = 1.5: must be in [0, 1]").wait_for()
        drawn(page, lambda: page.locator("#of-e").fill("0.6"))
        assert page.locator("#error").inner_text() == ""
        page.get_by_text("all other parameters").click()
        drawn(page, lambda: page.locator("#of-tilt").fill("2"))
        assert page.locator(".pictures").bounding_box()["height"] < 860  # however long the list beside them is
        assert page.url.endswith("#A_z=0.5&f=30&tilt=2")
        drawn(page, lambda: page.get_by_text("base case").click())
        assert page.url.endswith("#") and told(page) == "drift"
        drawn(page, lambda: page.locator("#shown").select_option("start"))
        assert page.evaluate("views[0].data.cycles[0]") == 0


def faults(page):
    """The lines that stand at fields, by the names of these."""
    marked = page.locator("[aria-invalid=true]")
    names = [each.get_attribute("id").removeprefix("of-") for each in marked.all()]
    assert all(page.locator(f"#of-{name}, #{name}").is_visible() for name in names)
    return {name: page.locator(f"#fault-of-{name}").inner_text() for name in names}


@needs_chromium
def test_each_field_at_fault_is_marked_and_the_others_stay(window):
    with opened(window) as page:
        before = page.locator(".numbers").inner_text()
        page.locator("#of-e").fill("half")
        page.locator("#of-f").fill("15 m")
        page.locator("#of-mu_h").evaluate(
            "(field) => { field.value = '0.1'; field.dispatchEvent(new Event('input')); }"
        )
        page.locator("#fault-of-mu_h").get_by_text("mu_h").wait_for()  # and what was folded is unfolded
        assert faults(page) == {
            "e": "e = 'half': must be a number",
            "f": "f = '15 m': the unit must be Hz, rpm or the like",
            "mu_h": "mu_h = 0.1: must be >= mu = 0.2 (stick friction is never below slip friction)",
        }
        described = page.locator("#of-e").get_attribute("aria-describedby")
        assert page.locator(f"#{described}").inner_text() == "e = 'half': must be a number"
        assert [page.locator(f"#of-{name}").input_value() for name in ("e", "f", "mu", "Gamma")] == [
            "half",
            "15 m",
            "0.2",
            "0.9",
        ]
        assert page.locator(".numbers").inner_text() == before and page.locator("#error").inner_text() == ""
        picture(page, "faults")
        page.locator("#of-f").fill("900 rpm")
        page.locator("#fault-of-f").wait_for(state="hidden")
        assert set(faults(page)) == {"e", "mu_h"}
        page.locator("#of-mu_h").fill("")
        drawn(page, lambda: page.locator("#of-e").fill("60 %"))
        assert faults(page) == {} and page.locator(".numbers").inner_text() == before
        assert page.locator("#slide-f").input_value() == "15" and page.locator("#slide-e").input_value() == "0.6"
        page.locator("#stretch").fill("0")
        page.get_by_text("stretch = 0: must be a whole number >= 1").wait_for()
        assert set(faults(page)) == {"stretch"}


@needs_chromium
def test_an_emptied_field_says_its_default_and_has_it(window):
    """Sliders go along, and the fields in whose place another one is given."""
    with opened(window) as page:
        field, slider = page.locator("#of-Gamma"), page.locator("#slide-Gamma")
        drawn(page, lambda: field.fill("1.2"))
        drawn(page, lambda: field.fill(""))
        assert (
            field.get_attribute("placeholder") == "0.9"
            and slider.input_value() == "0.9"
            and "0.9" in told(page, "conditions")
        )
        drawn(page, lambda: page.locator("#of-A_z").fill("1.5 mm"))
        assert (
            float(field.input_value()) == pytest.approx(1.5e-3 * (30 * np.pi) ** 2 / 9.81)
            and slider.input_value() == "1.36"
        )
        drawn(page, lambda: page.locator("#of-A_z").fill(""))
        assert field.input_value() == "0.9" and page.locator("#of-A_z").get_attribute("placeholder") == "0.993960811531"
        page.get_by_text("all other parameters").click()
        drawn(page, lambda: page.locator("#of-l").fill("6 cm"))
        assert page.locator("#of-A_r").input_value() == "7" == page.locator("#slide-A_r").input_value()
        drawn(page, lambda: page.locator("#of-v_z").fill("0.1 m/s"))
        assert float(page.locator("#of-A_z").input_value()) == pytest.approx(0.1 / (30 * np.pi) * 1e3)
        fields = page.locator(".dial input[id^=of-]")
        shown = dict(fields.evaluate_all("(all) => all.map(({ id, placeholder }) => [id, placeholder])"))
        assert shown["of-mu_1"] == "= μ" and all(shown.values())


WORDS = """() => [document.body.innerText, ...texts, ...[...document.querySelectorAll("*")].flatMap((each) =>
  [each.value, each.placeholder, each.title, each.ariaLabel, each.href].filter((word) => typeof word === "string"))]"""
STATES = [
    "r=4+mm",
    "Gamma=0",
    "xdot0=0",
    "Gamma=2.5&periods=1",
    "mu=0&mu_s=0",
    "e=0",
    "e=1&Gamma=0&periods=3",
    "gap0=100",
    "D_r=0",
    "A_z=0",
    "v_z=0+m/s",
    "l=10",
    "f=0.001",
    "f=1e9&Gamma=2&periods=2",
    "Gamma=1e9&periods=2",
    "e=NaN&f=Infinity",
    "Gamma=null",
    "A_z=undefined",
    "f=abc",
    "periods=",
    "rtol=x&stretch=x",
    "A_z=&f=",
    "shown=null",
    "%zz",
    "%",
    "e=%ff",
    "|",
    "at=1",
]


@pytest.mark.filterwarnings("ignore:.* is usual")
@needs_chromium
def test_no_state_shows_a_number_that_is_none(browser):
    with served() as address, chromium_page(browser, offline=False) as (page, errors):
        page.add_init_script(
            "window.texts = []; const pens = CanvasRenderingContext2D.prototype, write = pens.fillText;"
            "pens.fillText = function (text, ...at) { texts.push(String(text)); write.call(this, text, ...at); };"
        )
        page.goto(address)
        page.wait_for_function("document.body.dataset.drawn >= 1", timeout=90_000)
        for state in STATES:
            with page.expect_response("**/run?*") as answer:
                page.evaluate("(state) => { texts.length = 0; location.hash = state; }", state)
            answer.value.finished()
            page.evaluate("async () => { for (let n = 0; n < 3; n++) await new Promise(requestAnimationFrame); }")
            given = re.sub(r"[^\w]|_", " ", state)
            for words in page.evaluate(WORDS):
                said = re.findall(r"\b(?:NaN|[Ii]nfinity|undefined|null|inf|nan)\b", words)
                assert all(word in given for word in said) or "must be" in words, (state, words)
        assert errors == []


@needs_chromium
def test_links_are_links_and_the_way_back_is_kept(window, cube):
    with opened(window, cube) as page:
        drawn(page, lambda: page.locator("#of-f").fill("900 rpm"))
        drawn(page, lambda: page.locator("#of-e").fill("0.5"))
        page.locator("#of-mu").press("End")
        drawn(page, lambda: page.locator("#of-mu").press_sequentially("05"))  # two states in one step
        page.locator("#of-mu").blur()
        page.get_by_label("shown", exact=True).select_option("radius")
        page.get_by_label("f [Hz]").fill("1")
        page.locator("#key").get_by_text("radius [m]").wait_for()
        link = page.locator("a", has_text="copy link").get_attribute("href")
        assert link == page.url and "f=900+rpm&e=0.5&mu=0.205" in link
        page.locator("#of-f").blur()
        other = page.context.new_page()  # as another tab
        other.goto(link)
        other.wait_for_function("document.body.dataset.drawn >= 1")
        other.locator("#key").get_by_text("radius [m]").wait_for()
        assert (told(other), other.locator("#of-f").input_value(), other.url) == (told(page), "900 rpm", link)
        assert other.locator("#choices").inner_text() == page.locator("#choices").inner_text()
        assert other.get_by_label("f [Hz]").input_value() == "1"
        with page.context.expect_page() as base:
            page.locator("a", has_text="base case").click(modifiers=["Control"])
        base.value.wait_for_function("document.body.dataset.drawn >= 1")
        assert base.value.locator("#of-e").input_value() == "0.6" and page.locator("#of-e").input_value() == "0.5"
        drawn(page, page.go_back)  # the slice of the map; the run is drawn again
        drawn(page, page.go_back)  # what it shows
        assert page.get_by_label("shown", exact=True).input_value() == "mode"
        for way, e, mu in ((page.go_back, "0.5", "0.2"), (page.go_back, "0.6", "0.2"), (page.go_forward, "0.5", "0.2")):
            drawn(page, way)
            assert (page.locator("#of-e").input_value(), page.locator("#of-mu").input_value()) == (e, mu)
        page.reload()
        page.wait_for_function("document.body.dataset.drawn >= 1")
        assert page.locator("#of-e").input_value() == "0.5"
        # what a link tells in vain is told where it stands
        page.evaluate("() => { location.hash = 'at=9,0,0&compare=e%3Dhalf'; }")
        page.locator("#error").get_by_text("f = 9: must be a place from 0 to 1").wait_for()
        page.locator(".pinned .says").get_by_text("e = 'half': must be a number").wait_for()
        assert faults(page) == {}


@needs_chromium
def test_a_page_says_that_it_waits_and_that_nobody_answers(browser):
    with served() as address, chromium_page(browser, offline=False) as (page, _):
        page.add_init_script(
            "window.signs = []; document.addEventListener('DOMContentLoaded', () => {"
            " const sign = document.querySelector('#busy');"
            " new MutationObserver(() => signs.push(sign.textContent)).observe(sign, { childList: true }); });"
        )
        page.goto(address)
        page.wait_for_function("document.body.dataset.drawn >= 1", timeout=90_000)
        assert page.evaluate("signs")[0].startswith("loading the kernel; the first time it is compiled")
        page.wait_for_function("document.querySelector('#busy').textContent === ''")
        page.route("**/run?*", lambda route: (page.wait_for_timeout(500), route.continue_()))
        drawn(page, lambda: page.locator("#of-e").fill("0.7"))
        assert "running …" in page.evaluate("signs")
        page.unroute_all()
        page.context.set_offline(True)
        page.locator("#of-e").fill("0.8")
        page.get_by_text("the program that answers has ended; start it again").wait_for()


@needs_chromium
def test_a_map_is_clicked_compared_linked_copied_and_saved(window, cube, tmp_path):
    with opened(window, cube) as page:
        box = page.locator(".marks").bounding_box()

        def click(right, up):
            page.mouse.click(
                box["x"] + 46 + right * (box["width"] - 54), box["y"] + 8 + (1 - up) * (box["height"] - 38)
            )

        page.locator("#key i").first.wait_for()  # the map is drawn
        drawn(page, lambda: click(0.5, 0.75))
        assert page.locator("#cell").inner_text() == "β(0) [°] 16, Γ 0.9: drift"
        assert told(page) == "drift" and "at=0%2C1%2C2" in page.url
        page.locator("body").press("c")
        page.locator(".pinned .conditions").get_by_text("β(0)").wait_for()
        drawn(page, lambda: click(0.1, 0.25))
        assert told(page) == cube.dimersweep.modes().values[0, 0, 0]
        assert (told(page, view=1), page.locator("#of-beta0").input_value()) == ("drift", "8")
        drawn(page, lambda: page.locator(".marks").press("ArrowUp"))
        assert page.locator("#of-Gamma").input_value() == "0.9"
        picture(page, "compare")
        # the link leads to the same two points
        page.get_by_text("copy link").click()
        link, modes = page.evaluate("navigator.clipboard.readText()"), [told(page), told(page, view=1)]
        assert link == page.url
        drawn(page, lambda: page.get_by_text("end comparison").click() or page.get_by_text("base case").click())
        page.goto("about:blank")
        page.goto(link)
        page.wait_for_function("document.body.dataset.drawn >= 2", timeout=30_000)
        assert [told(page), told(page, view=1)] == modes
        assert page.locator("#of-beta0").input_value() == "8"
        # another quantity, another slice
        page.get_by_label("f [Hz]").fill("1")
        page.get_by_label("shown", exact=True).select_option("radius")
        page.locator("#key").get_by_text("radius [m]").wait_for()
        # out of the page
        page.get_by_role("button", name="Python").first.click()
        code = page.evaluate("navigator.clipboard.readText()")
        assert code == page.locator(".run pre").first.inner_text()
        assert made_by(code).mode == modes[0]
        for kind, name in (("png", "dimer.png"), ("csv", "dimer.csv")):
            with page.expect_download() as download:
                page.locator(f"[data-save={kind}]").first.click()
            assert download.value.suggested_filename == name
            download.value.save_as(tmp_path / name)
        assert len(colors_of((tmp_path / "dimer.png").read_bytes())) > 5
        numbers = np.loadtxt(tmp_path / "dimer.csv", delimiter=",", skiprows=2)
        assert (tmp_path / "dimer.csv").read_text().splitlines()[1].startswith("time [s],x1 [mm],")
        run = made_by(code)
        shown = min(6, run.n_periods)  # forcing periods
        assert shown - 1 < np.ptp(numbers[:, 0] * run.parameters["f"]) <= shown
        rods = np.linalg.norm(numbers[:, 1:4] - numbers[:, 4:7], axis=1)
        np.testing.assert_allclose(rods, 50, atol=0.02)


RINGS = """() => {
  const canvas = document.querySelector(".marks"), context = canvas.getContext("2d");
  return context.getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value > 0);
}"""


@needs_chromium
def test_a_run_has_a_ring_on_the_map_where_it_lies_on_it(window):
    """The map is of another dimer than the base case, and of Gamma from 0.8 to 0.9."""
    other = dimersweep.sweep({"Gamma": [0.8, 0.9], "beta0": [0.2, 0.3]}, {"e": 0.65}, periods=60, progress=False)
    with opened(window, other) as page:
        page.locator("#key i").first.wait_for()
        assert not page.evaluate(RINGS)
        drawn(page, lambda: page.locator("#of-e").fill("0.65"))
        assert page.evaluate(RINGS)
        for name, value, lies in (("Gamma", "1.4", False), ("Gamma", "0.85", True), ("mu", "0.1", False)):
            drawn(page, lambda name=name, value=value: page.locator(f"#of-{name}").fill(value))
            assert page.evaluate(RINGS) == lies, name


@needs_chromium
def test_the_page_fits_a_telephone_and_goes_dark(window, cube):
    with opened(window, cube, width=390, height=844) as page:
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        for name in (".side", "#slide-Gamma", ".map", "footer"):
            page.locator(name).scroll_into_view_if_needed()
            box = page.locator(name).bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= 390, name
        assert page.locator(".side").is_visible()
        page.locator("#slide-Gamma").scroll_into_view_if_needed()
        side, slider = page.locator(".side").bounding_box(), page.locator("#slide-Gamma").bounding_box()
        assert side["y"] + side["height"] < slider["y"] + slider["height"] < 844  # both are seen at once
        light = colors_of(page.screenshot())
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(300)
        dark = colors_of(page.screenshot())
        picture(page, "telephone")
        assert light.get((3, 3, 3), 0) > 100_000 > dark.get((3, 3, 3), 0) and dark.get((0, 0, 0), 0) > 100_000


MARKUP = '<img src=x onerror="window.hit=1"><script>window.hit=1</script> *a* [b](javascript:alert) $c$ & d'


@needs_chromium
def test_markup_in_a_cube_is_shown_as_it_is_written(window, cube):
    word, name = MARKUP.replace(" ", "/"), "v" + MARKUP.replace("/", "")
    held = cube.copy()
    held["mode"] = cube["mode"].assign_attrs(flag_meanings=" ".join([word] * len(cube["mode"].attrs["flag_values"])))
    held[name] = held["radius"]
    with opened(window, held.assign_attrs(title=MARKUP)) as page:
        assert page.locator("h1").inner_text() == MARKUP
        page.locator("#key i").first.wait_for()  # the map is drawn
        page.locator(".marks").hover()
        page.get_by_text(word).wait_for()
        page.get_by_label("shown", exact=True).select_option(name)
        page.locator("#key").get_by_text("[m]").wait_for()
        assert page.evaluate("window.hit") is None
        assert page.locator("img").count() == 0


@needs_chromium
def test_a_notebook_shows_the_page_of_a_run(browser, tmp_path):
    """In a frame that holds all of it, without a network; it plays, and fills its frame."""
    run = dimersweep.simulate(periods=60)
    (tmp_path / "notebook.html").write_text(f"<!DOCTYPE html><body>{run.view(periods=2)._repr_html_()}", "utf-8")
    with chromium_page(browser, offline=True) as (page, errors):
        page.goto((tmp_path / "notebook.html").as_uri())
        frame = page.frame_locator("iframe")
        frame.get_by_text("pause").wait_for()
        assert frame.locator(".mode").inner_text() == "drift"
        first = frame.locator("#now").inner_text()
        frame.locator("#now").filter(has_not_text=first).wait_for()
        assert frame.locator(".pictures").bounding_box()["height"] > 500
        assert errors == []


def test_a_frame_shows_a_page_that_is_served(cube):
    explorer = dimersweep.explore(cube)
    try:
        assert f'src="{explorer.address}"' in explorer._repr_html_()
        assert "some starts" in fetched(explorer.address)
    finally:
        explorer.close()

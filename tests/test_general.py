"""Unlike ends, other contacts and other plates: whole runs against references, symmetries and closed forms."""

import json
import os
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from dimersweep import names, simulate
from dimersweep.kernel.contact.coordinates import N_Y
from dimersweep.kernel.contact.forces import COMPLIANCE, N_F
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import CB, D1, D2, N_STATE, SPIN, STICK, THETA, WP, X1, Y1
from tests.checks.data import data
from tests.checks.examine import kinetic
from tests.checks.launch import launch
from tests.checks.scenes import UNITS, difference, engine_states, exchanged_ends, turned_plate
from tests.checks.verbs import contact_rates, contact_state, dimer, levers, row_of

REFERENCE = Path(os.environ.get("DIMERSWEEP_SHARED", Path(__file__).parents[2] / "shared")) / "reference"

pytestmark = pytest.mark.jit

# --- runs of another program ------------------------------------------------------------------------------------------


def stored_runs():
    """Runs of the other program, by their numbers; none where they are not here."""
    path = REFERENCE / "states_general.json"
    return {case["case"]: case for case in json.loads(path.read_text())["cases"]} if path.exists() else {}


@pytest.mark.skipif(not stored_runs(), reason="external reference not here")
@pytest.mark.parametrize("rtol", [1e-10, 1e-8])
@pytest.mark.parametrize("number", stored_runs() or [0])
def test_runs_of_another_program(number, rtol):
    """Each sample of each run, in units of SCALE, to what the other program says of its own accuracy in that case."""
    case = stored_runs()[number]
    samples = np.array(case["samples"])
    states, _ = engine_states(case["params"], samples[:, 0], rtol)
    assert difference(states, samples[:, 1:]) < case["accuracy"]


# --- symmetries -------------------------------------------------------------------------------------------------------

GENERAL = data("scenes")["general"]
PARTS, SCENES = GENERAL["parts"], GENERAL["scenes"]
UNLIKE = PARTS | GENERAL["contacts"]
scenes = pytest.mark.parametrize("name", SCENES)
INSTANTS = np.linspace(0.0, 4 / 15, 81)


def states_of(**scene):
    """States of a run of four periods, in arrays."""
    run = simulate(**scene, periods=4, rtol=1e-12)
    assert run.status == "ok", run.message
    states = run.states(INSTANTS)
    return {name: states[name].values for name in UNITS} | {"kinds": set(names(run.events["kind"]).values)}


def assert_same(states, expected, names, within):
    """Compare quantities of two runs, in their units."""
    worst = {name: np.abs(states[name] - expected[name]).max() / UNITS[name] for name in names}
    assert max(worst.values()) < within, worst


def exchanged(scene):
    """A scene with its ends numbered the other way round."""
    return exchanged_ends(scene) | {"beta0": -scene["beta0"], "theta0": scene.get("theta0", 0.0) + pi}


@scenes
def test_exchanged_ends_move_as_before(name):
    scene = UNLIKE | SCENES[name]
    before, after = states_of(**scene), states_of(**exchanged(scene))
    seen = {name: after[name] for name in ("x", "y", "theta_rate")}
    seen |= {f"gap_{i}{rate}": after[f"gap_{3 - i}{rate}"] for i in (1, 2) for rate in ("", "_rate")}
    seen |= {name: -after[name] for name in ("beta", "beta_rate", "gamma_rate")}
    seen |= {"theta": after["theta"] - pi, "gamma": -after["gamma"]}
    for track in ("x", "y"):  # counted from where they start: that is ball 1, which is another one
        before[track], seen[track] = before[track] - before[track][0], seen[track] - seen[track][0]
    before["gamma"], seen["gamma"] = before["gamma"] - before["gamma"][0], seen["gamma"] - seen["gamma"][0]
    assert_same(seen, before, seen, 1e-10)


def test_the_scenes_hold_every_phase():
    kinds = set().union(*(states_of(**UNLIKE | scene)["kinds"] for scene in SCENES.values()))
    wanted = {
        "SC1_sp",
        "SC2_sp",
        "SC2_sk",
        "DC_sp_sp",
        "DC_sk_sp",
        "DC_sp_sk",
        "DC_sk_sk",
        "SI1_sp",
        "SI2_sp",
        "DI_sp_sp",
    }
    assert wanted <= kinds, sorted(kinds)


def turned(scene, angle):
    """A scene with start, azimuth and the plate's motion along itself turned about the vertical."""
    v_x, v_y = scene.get("xdot0", 1.0), scene.get("ydot0", 0.0)
    start = {"xdot0": v_x * cos(angle) - v_y * sin(angle), "ydot0": v_x * sin(angle) + v_y * cos(angle)}
    return scene | turned_plate(scene, angle) | start | {"theta0": scene.get("theta0", 0.0) + angle}


@scenes
@pytest.mark.parametrize("angle", [0.7, pi])
def test_everything_turned_turns_the_track(name, angle):
    scene = UNLIKE | SCENES[name]
    before, after = states_of(**scene), states_of(**turned(scene, angle))
    for one, two in (("x", "y"), ("x1", "y1"), ("x1_rate", "y1_rate")):
        x, y = before[one], before[two]
        before[one], before[two] = x * cos(angle) - y * sin(angle), x * sin(angle) + y * cos(angle)
    before["theta"] = before["theta"] + angle
    assert_same(after, before, UNITS, 1e-12)


@scenes
def test_without_friction_the_plate_moves_nothing_sideways(name):
    """The centre of mass has a closed form, whatever the ends do; for the rest the plate need not move along itself."""
    smooth = (
        UNLIKE | SCENES[name] | {f"{kind}_{i}": 0.0 for kind in ("mu", "mu_s", "mu_h") for i in (1, 2)} | {"xdot0": 0.3}
    )
    states, still = states_of(**smooth), states_of(**smooth | {"Gamma_x": 0.0, "Gamma_y": 0.0, "xdot0": -0.2})
    tilt, azimuth, g, omega = smooth.get("tilt", 0.0), smooth.get("azimuth", 0.0), 9.81, 2 * pi * 15
    for axis, fall, start in (("x", cos(azimuth), 0.3), ("y", sin(azimuth), 0.0)):
        Gamma, lead = smooth.get(f"Gamma_{axis}", 0.0), smooth.get(f"phi_{axis}", 0.0)
        plate = Gamma * g / omega**2 * (np.sin(omega * INSTANTS + lead) - sin(lead))
        moved = start * INSTANTS + 0.5 * g * sin(tilt) * fall * INSTANTS**2 - plate
        np.testing.assert_allclose(states[axis] - states[axis][0], moved, atol=1e-14)
    assert_same(states, still, ("theta", "beta", "gamma", "gap_1", "gap_2", "beta_rate", "theta_rate"), 1e-11)


THROWN = {"gap0": 5e-3, "gammadot0": 30.0, "thetadot0": 2.0, "Gamma": 0.0}


@pytest.mark.parametrize(
    "scene",
    [
        THROWN | {"beta0": 0.4, "xdot0": 0.5, "gap0": 0.01, "thetadot0": 0.0},
        UNLIKE | THROWN | {"beta0": -0.4, "xdot0": 0.2, "ydot0": -0.3, "gammadot0": -40.0},
    ],
    ids=["alike", "unlike"],
)
def test_a_plate_that_moves_evenly_along_itself_changes_nothing(scene):
    """Galilei, with friction: start and plate have a common velocity more, and the motion over the plate is the same.

    A plate that moves along itself at 1e-6 Hz moves evenly while this one bounces, slips and comes to rest: within 0.28 s its
    velocity changes by 2e-12 of itself.
    """
    f, even = 1e-6, {"x": 1.0, "y": -0.7}
    shaken = {f"Gamma_{axis}": abs(v) * 2 * pi * f / 9.81 for axis, v in even.items()}
    shaken |= {f"phi_{axis}": 0.0 if v > 0 else pi for axis, v in even.items()}
    faster = {f"{axis}dot0": scene.get(f"{axis}dot0", 0.0) + v for axis, v in even.items()}
    still, moved = (simulate(**scene | more, f=f, periods=1, rtol=1e-12) for more in ({}, shaken | faster))
    times = np.linspace(0.0, 0.28, 57)
    before, after = ({name: run.states(times)[name].values for name in UNITS} for run in (still, moved))
    assert_same(after, before, UNITS, 1e-10)
    kinds = set(names(still.events["kind"]).values)
    assert {"SI1_sp", "SI2_sp", "DI_sp_sp", "DC_sk_sk"} <= kinds


@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_elastic_bounces_keep_the_energy_in_the_tilted_potential(tilt):
    scene = {name: value for name, value in UNLIKE.items() if not name.startswith(("mu", "e_"))}
    scene |= {"mu": 0.0, "mu_s": 0.0, "e": 1.0, "Gamma": 0.0, "beta0": 0.4, "tilt": tilt, "azimuth": 1.0}
    run = simulate(**scene, periods=1000, rtol=1e-12)
    assert run.status == "ok"
    s = run.states(np.linspace(0, 1000 / 15, 2001))
    dm = dimer(**scene)
    beta, theta, g = s["beta"].values, s["theta"].values, 9.81
    h, w_b, w_t = -dm.p1.h, s["beta_rate"].values, s["theta_rate"].values
    x_rate = s["x1_rate"] - h * (np.cos(beta) * np.cos(theta) * w_t - np.sin(beta) * np.sin(theta) * w_b)
    y_rate = s["y1_rate"] - h * (np.cos(beta) * np.sin(theta) * w_t + np.sin(beta) * np.cos(theta) * w_b)
    n_rate = s["gap_1_rate"] + h * np.cos(beta) * w_b
    spin = s["gamma_rate"] + w_t * np.sin(beta)
    moving = (
        dm.m * (x_rate**2 + y_rate**2 + n_rate**2) + dm.J_t * (w_b**2 + (np.cos(beta) * w_t) ** 2) + dm.J_a * spin**2
    )
    height = s["gap_1"] + dm.p1.r + h * np.sin(beta)
    down = s["x"] * cos(1.0) + s["y"] * sin(1.0)
    energy = (0.5 * moving + dm.m * g * (height * cos(tilt) - down * sin(tilt))).values
    assert np.ptp(energy) < 1e-10 * np.ptp(0.5 * moving.values)


# --- a cone that rolls ------------------------------------------------------------------------------------------------

ROLLING = {name: value for name, value in PARTS.items() if not name.startswith("mu")} | {"mu": 9.0, "Gamma": 0.0}


def rolling(scene, omega):
    """A dimer on both ends that rolls about its line of contact at the rate `omega`, and its constants."""
    row = row_of(**scene)
    dm = dimer_of(row)
    p = levers(dm, -1.0, dm.sin_0, dm.cos_0)
    state = np.zeros(N_STATE)
    state[WP], state[SPIN] = -omega * dm.sin_0, omega * dm.cos_0
    state[CB] = -p.b * state[WP] - p.c * state[SPIN]
    return row, dm, state, p.a


def pressed(dm, omega, height):
    """Normal forces of both ends of a rolling cone.

    The spin L = omega (J_a cos^2 + J_t sin^2) along the line of contact turns with theta', and the centre of mass goes round
    the apex at omega z_0: the moment of the normal forces and of the friction that pulls towards the apex has to turn it.
    """
    tan_0 = dm.sin_0 / dm.cos_0
    moment = omega**2 * tan_0 * (dm.m * height**2 + dm.J_a * dm.cos_0**2 + dm.J_t * dm.sin_0**2) / dm.cos_0
    return np.array([dm.m * dm.g * dm.p2.h - moment, moment - dm.m * dm.g * dm.p1.h]) / dm.l


@pytest.mark.parametrize("ends", [{}, {"r_1": 4e-3, "r_2": 6e-3}])
def test_two_ends_that_stick_roll_as_a_cone(ends):
    row, dm, state, height = rolling(ROLLING | ends, 30.0)
    assert height == pytest.approx(dm.p1.r - dm.p1.h * dm.sin_0, rel=1e-15)
    assert state[CB] == pytest.approx(30.0 * height, rel=1e-14)
    run = launch(row, state, 20, 1e-12)
    assert run.status == "ok"
    turn, radius, time = -30.0 * dm.sin_0 / dm.cos_0, height * dm.cos_0 / dm.sin_0, 20 / 15
    last = run.state
    assert last[THETA] == pytest.approx(turn * time, rel=1e-12)
    np.testing.assert_allclose(last[[WP, SPIN, CB]], state[[WP, SPIN, CB]], rtol=1e-13)

    def centre(s):
        return np.array([s[X1] + dm.p1.h * dm.cos_0 * sin(s[THETA]), s[Y1] - dm.p1.h * dm.cos_0 * cos(s[THETA])])

    # about the apex, which lies on the axis, towards the lesser ball
    start, end = ((-sin(angle), cos(angle)) for angle in (0.0, last[THETA]))
    np.testing.assert_allclose(centre(last) - centre(state), radius * (np.array(end) - start), atol=1e-13)
    assert kinetic(dm, last) == pytest.approx(kinetic(dm, state), rel=1e-13)


@pytest.mark.parametrize("ends", [{}, {"r_1": 4e-3, "r_2": 6e-3}])
def test_a_cone_that_rolls_presses_as_derived_and_lifts_off_where_an_end_presses_no_more(ends):
    row, dm, state, height = rolling(ROLLING | ends, 30.0)
    y, dy, F = np.zeros(N_Y), np.zeros(N_Y), np.zeros(N_F)
    contact_state(dm, state, -1.0, y)
    contact_rates(dm, np.array([STICK, STICK], float), 0.0, y, dy, F)
    forces, weight = F[:COMPLIANCE].reshape(2, 3), dm.m * dm.g
    np.testing.assert_allclose(forces[:, 0], pressed(dm, 30.0, height), atol=1e-13 * weight)
    pull = -dm.m * 30.0**2 * height * dm.sin_0 / dm.cos_0  # towards the apex, which is beyond the lesser ball
    assert forces[:, 1].sum() == pytest.approx(pull, abs=1e-13 * weight)
    np.testing.assert_allclose(forces[:, 2], 0.0, atol=1e-13 * weight)

    limit = brentq(lambda omega: pressed(dm, omega, height).min(), 1.0, 1e4, xtol=1e-12)
    for share, stays in ((1 - 1e-11, True), (1 + 1e-11, False)):
        row, _, state, _ = rolling(ROLLING | ends, share * limit)
        last = launch(row, state, 1, 1e-12).state
        assert (last[D1] == last[D2] == 0.0) == stays


def test_a_pair_on_a_plate_that_shakes_sideways_sets_out_once():
    """Friction along the axis and to the side holds it up to one limit; it then slips as both ask, and stays so."""
    run = simulate(**data("scenes")["motions"]["sets out"], periods=100, rtol=1e-10)
    assert run.status == "ok", run.message
    assert run.n_events < 100 * run.n_periods

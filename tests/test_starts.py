"""Starts that are given by parameters: what each means, against closed forms, symmetries, a given state and the slow oracle."""

import json
from math import cos, pi, sin

import numpy as np
import pytest
import xarray as xr

from dimersweep import load_run, names, orbits, refine, search, simulate, sweep
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.body import dimer_of
from dimersweep.parameters import Parameters
from dimersweep.studies.declared import Declaration
from dimersweep.symbols import BASE, LEFT_OUT, START, STATE_QUANTITIES
from tests import oracle
from tests.checks.scenes import UNITS, difference, engine_states, sample_times, started_scene
from tests.oracle.body import dimer

jit = pytest.mark.jit
RATES = ("xdot0", "ydot0", "betadot0", "thetadot0", "gammadot0")
UNLIKE = {"r_1": 6e-3, "r_2": 4e-3, "rho_b_2": 5000.0, "A_r": 5.0}
TURNING = {"xdot0": 0.3, "ydot0": -0.2, "betadot0": 3.0, "thetadot0": -2.0, "gammadot0": 40.0, "theta0": 0.5}
THROWN = UNLIKE | TURNING | {"gap0": 0.3, "beta0": 0.3, "phi0": 1.0}
SHAKEN = {"Gamma_x": 0.1, "phi_x": 1.0, "Gamma_y": 0.2, "phi_y": 0.3}
NEW = {"ydot0": 0.2, "betadot0": 1.0, "thetadot0": 1.0, "gammadot0": 30.0, "gap0": 1e-3}


def pair(x, y, z):
    return np.array([x, y, z])


def frame(beta, theta):
    """Unit vector from p1 to p2, its derivatives by beta and by theta, and the vector it turns about with beta."""
    axis = pair(-cos(beta) * sin(theta), cos(beta) * cos(theta), sin(beta))
    by_beta = pair(sin(beta) * sin(theta), -sin(beta) * cos(theta), cos(beta))
    by_theta = pair(-cos(beta) * cos(theta), -cos(beta) * sin(theta), 0.0)
    return axis, by_beta, by_theta


def turned(vector, about, angle):
    """A vector turned about a unit vector (Rodrigues)."""
    return vector * cos(angle) + np.cross(about, vector) * sin(angle) + about * (about @ vector) * (1 - cos(angle))


def thrown(scene, t):
    """Centre of ball 1, its velocity, and the axis, of a top that is thrown: all in closed form, in the room."""
    d = dimer(scene)
    axis, by_beta, by_theta = frame(scene["beta0"], scene["theta0"])
    rate = by_beta * scene["betadot0"] + by_theta * scene["thetadot0"]
    spin = scene["gammadot0"] + scene["thetadot0"] * sin(scene["beta0"])
    momentum = d.J1 * np.cross(axis, rate) + d.J2 * spin * axis
    about, speed = momentum / np.linalg.norm(momentum), np.linalg.norm(momentum) / d.J1
    plate = d.A[0, 2] * sin(scene["phi0"])
    ball = pair(0.0, 0.0, d.r[0] + scene["gap0"] + plate)  # p1 is the lower end
    centre = ball + d.h * axis + (pair(scene["xdot0"], scene["ydot0"], 0.0) + d.h * rate) * t
    centre[2] -= 0.5 * d.g * t**2
    now = turned(axis, about, speed * t)
    return centre - d.h * now, now


@jit
def test_a_dimer_that_is_thrown_moves_as_a_top():
    """The velocity given is that of the centre of ball 1 in the room, the rates are those of the paper's angles."""
    times = np.linspace(0.0, 0.2, 21)
    states = simulate(**THROWN, periods=3, rtol=1e-12).states(times)
    assert not states["contact_state"].values.any()  # all in the air
    for k, t in enumerate(times):
        ball, axis = thrown(THROWN, t)
        now = states.isel(time=k)
        assert [now[name].item() for name in ("x1", "y1", "z1")] == pytest.approx(list(ball), abs=1e-13)
        assert list(frame(now["beta"].item(), now["theta"].item())[0]) == pytest.approx(list(axis), abs=1e-13)
    first = states.isel(time=0)
    for name, given in zip(("x1", "y1", "beta", "theta", "gamma"), RATES, strict=True):
        assert first[f"{name}_rate"].item() == pytest.approx(THROWN[given], rel=1e-14)
    assert first["z1_rate"].item() == pytest.approx(0.0, abs=1e-14)
    assert first["gap_1"].item() == pytest.approx(0.3, rel=1e-15)


@jit
def test_a_dimer_that_is_dropped_lands_when_it_has_fallen_so_far():
    run = simulate(Gamma=0.0, gap0=0.02, beta0=0.4, xdot0=0.0, periods=3, rtol=1e-12)
    events = run.events
    landed = events["time"].values[names(events["cause"]) == "impact"][0]
    assert landed == pytest.approx((2 * 0.02 / 9.81) ** 0.5, rel=1e-13)


@jit
@pytest.mark.parametrize("beta0", [0.3, -0.4])
@pytest.mark.parametrize("gap0", [0.0, 2e-3])
def test_parameters_of_a_start_mean_what_a_given_state_does(beta0, gap0):
    scene = UNLIKE | SHAKEN | TURNING | {"beta0": beta0, "gap0": gap0, "phi0": 0.7}
    d = dimer({name: value for name, value in scene.items() if name not in START})
    along = d.A[0, :2] * d.omega * np.cos(d.phi[0, :2])  # states are relative to the plate, starts are not
    state = {
        "x1_rate": scene["xdot0"] - along[0],
        "y1_rate": scene["ydot0"] - along[1],
        "z1_rate": 0.0,
        "beta": beta0,
        "beta_rate": scene["betadot0"],
        "theta": scene["theta0"],
        "theta_rate": scene["thetadot0"],
        "gamma_rate": scene["gammadot0"],
        "phase": scene["phi0"],
        "gap_1" if beta0 > 0 else "gap_2": gap0,
    }
    held = {name: value for name, value in scene.items() if name not in (*START, "phi0")}
    one, two = (simulate(**given, periods=4, rtol=1e-12) for given in (scene, held | {"start": state}))
    times = np.linspace(0.0, 4 / 15, 33)
    before, after = one.states(times), two.states(times)
    for name, unit in UNITS.items():
        np.testing.assert_allclose(before[name], after[name], rtol=0, atol=1e-10 * unit, err_msg=name)


@jit
@pytest.mark.parametrize("beta0", [0.3, -0.2])
def test_exchanged_ends_start_as_before(beta0):
    """The same start told of the other ball; that one rests along z only where the dip angle does."""
    scene = UNLIKE | TURNING | {"beta0": beta0, "gap0": 1e-3, "betadot0": 0.0}
    length, theta, turns = dimer(scene).l, scene["theta0"], scene["thetadot0"]
    ends = {f"{name}_{i}": f"{name}_{3 - i}" for name in ("r", "rho_b") for i in (1, 2)}
    other = {ends.get(name, name): value for name, value in ({"rho_b_1": 7850.0} | scene).items()}
    other |= {"beta0": -beta0, "theta0": theta + pi, "gammadot0": -scene["gammadot0"]}
    other["xdot0"] -= length * cos(beta0) * cos(theta) * turns
    other["ydot0"] -= length * cos(beta0) * sin(theta) * turns
    times = np.linspace(0.0, 3 / 15, 31)
    before, after = (simulate(**each, periods=3, rtol=1e-12).states(times) for each in (scene, other))
    for one, two, sign in (
        ("gap_1", "gap_2", 1), ("gap_2", "gap_1", 1), ("beta", "beta", -1), ("theta_rate", "theta_rate", 1),
        ("gamma_rate", "gamma_rate", -1), ("beta_rate", "beta_rate", -1),
    ):  # fmt: skip
        np.testing.assert_allclose(before[one], sign * after[two], rtol=0, atol=1e-10 * UNITS[one], err_msg=one)
    for name in ("x", "y"):
        moved, seen = (states[name] - states[name][0] for states in (before, after))
        np.testing.assert_allclose(moved, seen, rtol=0, atol=1e-10 * UNITS[name], err_msg=name)


@jit
def test_the_mirror_image_of_a_start_has_the_mirror_image_of_its_motion():
    """At the plane of y and z: velocities along X, headings and spins change their signs."""
    scene = UNLIKE | TURNING | {"beta0": 0.2, "gap0": 1e-3}
    odd = ("xdot0", "theta0", "thetadot0", "gammadot0")
    image = scene | {name: -scene[name] for name in odd}
    times = np.linspace(0.0, 3 / 15, 31)
    before, after = (simulate(**each, periods=3, rtol=1e-12).states(times) for each in (scene, image))
    for name in ("x1", "y1", "gap_1", "gap_2", "theta", "beta", "theta_rate", "beta_rate", "gamma_rate"):
        sign = -1 if name in ("x1", "theta", "theta_rate", "gamma_rate") else 1
        np.testing.assert_allclose(before[name], sign * after[name], rtol=0, atol=1e-10 * UNITS[name], err_msg=name)


@jit
@pytest.mark.parametrize("seed", range(10))
def test_starts_against_the_slow_oracle(seed):
    """Hops below 1e-8 m/s are beyond the oracle where the plate is tilted: it lets an end fall through (seed 2)."""
    scene = started_scene(seed)
    times = sample_times(scene, periods=1)
    expected = oracle.simulate(scene, times, rtol=1e-9, v_rest=1e-8)
    assert expected["status"] == "done"
    states, _ = engine_states(scene, times, 1e-10)
    assert difference(states, expected["samples"][:, 1:]) < 1e-6


def test_without_them_a_start_is_the_paper_s():
    zero = dict.fromkeys(NEW, 0.0)
    assert Parameters(**zero).row().tobytes() == Parameters().row().tobytes()
    assert set(NEW) <= set(LEFT_OUT) and set(NEW) <= set(START)
    assert not set(NEW) & set(Parameters(**zero).given())


@jit
@pytest.mark.parametrize("name", NEW)
def test_each_is_an_axis_of_sweeps_tables_searches_maps_and_files(name):
    values = [0.0, NEW[name]]
    runs = [simulate(**{name: value}, periods=30, stop_when_settled=True, record=False) for value in values]
    quiet = {"periods": 30, "progress": False}
    cube = sweep({name: values}, **quiet)
    table = sweep(points={name: values}, **quiet)
    for each in (cube, table):
        assert each["n_events"].values.tolist() == [run.n_events for run in runs]
        assert each["down_share_1"].values.tolist() == [run.down_share_1 for run in runs]
    assert runs[0].n_events != runs[1].n_events  # it does something
    assert cube[name].attrs["units"] == table[name].attrs["units"]
    asked = search({name: values, "beta0": [0.2, 0.3]}, over=name, ask="fraction", **quiet)
    assert asked["n_runs"].values.tolist() == [2, 2]
    axes = {name: values, "Gamma": [0.5, 0.9], "beta0": [0.2, 0.3]}
    fine = refine(axes, halvings={name: 1}, over="beta0", **quiet)
    assert fine[name].values.tolist() == [0.0, 0.5 * NEW[name], NEW[name]]
    assert set(names(fine["region"]).sel(Gamma=0.5).values.tolist()) == {"rest"}
    declared = Declaration.model_validate(
        {"sweep": {"periods": 30, "output": "x.nc"}, "grid": {name: values}, "fixed": {"Gamma": 0.9}}
    )
    assert declared.study().grid.axes[name].tolist() == values


@jit
def test_each_is_an_option_of_the_command_line(call):
    given = [text for name, value in NEW.items() for text in (f"--{name}", f"{value:g}")]
    told = json.loads(call("simulate", *given, "--periods", "30", "--json")[0])
    assert told["parameters"].items() >= NEW.items()
    assert told["n_events"] == simulate(**NEW, periods=30, record=False).n_events


# --- starts from another run ------------------------------------------------------------------------------------------

MAPPED = tuple(name for name in STATE_QUANTITIES if name not in ("contact_state", "phase", "theta", "gamma"))
SENSITIVE = (
    1e-4  # a scene whose states are so far from those at another accuracy, in their units, enlarges every rounding
)


def apart(one, two):
    """How far states are from each other, in the units of each quantity; angles of which only sines count are left out."""
    return max(np.abs(one[name].values - two[name].values).max() / UNITS.get(name, 1.0) for name in MAPPED)


@jit
def test_a_run_goes_on_from_any_moment_of_another():
    """80 scenes of the whole model: starts from states, from sections, from ends of runs, and from what these say."""
    sensitive, second = 0, 0
    for seed in range(80):
        rng = np.random.default_rng([20240306, seed])
        scene = started_scene(seed) | {"D_r": 1e-3, "phi0": float(rng.uniform(0, 2 * pi))}
        f, second = scene["f"], second + ("Gamma_2" in scene)
        run = simulate(**scene, periods=3, rtol=1e-10)
        assert run.status == "ok"
        way = ("states", "section", "run", "told")[seed % 4]
        time = {"section": 1.0, "run": 2.0}.get(way, float(rng.uniform(0.5, 2.0))) / f
        begun = run.states(time)
        start, given = begun, {}
        if way == "section":
            start = run.section().isel(n=1)
        elif way == "run":
            start = simulate(**scene, periods=2, rtol=1e-10)
        elif way == "told":
            start = {name: begun[name].item() for name in begun.data_vars if name in STATE_QUANTITIES}
            given = {name: value for name, value in scene.items() if name not in START and name != "phi0"}
        if way == "told" and "Gamma_2" in scene:  # numbers know of no run: phi_2 is that of a plate with phi0 = 0
            given["phi_2"] = scene["phi_2"] - 2 * scene["phi0"]
        again, ahead = simulate(start=start, **given, periods=1, rtol=1e-10), np.array([0.3, 0.7, 1.0]) / f
        off = apart(again.states(ahead), run.states(time + ahead))
        if off > 1e-8:
            sensitive += 1
            finer = simulate(**scene, periods=3, rtol=1e-12)
            assert apart(finer.states(time + ahead), run.states(time + ahead)) > SENSITIVE, (seed, way, off)
    assert sensitive <= 1 and second > 40


@jit
def test_a_start_brings_the_parameters_of_its_run_and_those_given_take_their_place(tmp_path):
    plate = {"e_1": 0.5, "e_2": 0.7, "Gamma_2": 0.2, "phi_2": 0.4, "tilt": 0.02, "f": 20.0, "mu": 0.2}
    run = simulate(**plate, beta0=0.2, gammadot0=30.0, periods=3)
    run.save(tmp_path / "run.nc")
    cube = sweep(
        {"f": [20.0, 21.0]}, fixed={name: plate[name] for name in plate if name != "f"}, periods=3, progress=False
    )
    brought = Parameters(**plate).given()
    starts = (run, load_run(tmp_path / "run.nc"), run.states(0.15), run.states([0.1, 0.15]).isel(time=1))
    for start in (*starts, run.section().isel(n=3), run.section(at="double_impact").isel(n=0), cube.isel(f=0)):
        for given in ({}, {"mu": 0.1}, {"e": 0.4}):
            found = simulate(start=start, **given, periods=1, record=False).parameters
            wanted = {name: value for name, value in brought.items() if not ("e" in given and name in ("e_1", "e_2"))}
            left = {"phi0", "phi_2", *START}
            assert {n: v for n, v in found.items() if n not in left} == {
                n: v for n, v in (wanted | given).items() if n not in left
            }
            lag = found["phi_2"] - 2 * found["phi0"] - plate["phi_2"]
            assert lag == pytest.approx(2 * pi * round(lag / (2 * pi)), abs=1e-9)
    assert simulate(start={"beta": 0.2}, periods=1).parameters["mu"] == BASE["mu"]


def across_and_axial(state):
    """Components of the rate of rotation across the axis, in the vertical plane, and along it [rad/s]."""
    beta, rate = state["beta"].item(), state["theta_rate"].item()
    return rate * cos(beta), state["gamma_rate"].item() + rate * sin(beta)


@jit
@pytest.mark.parametrize("changes", [{"A_r": 7.0}, {"r": 4e-3}, {"r_1": 6e-3, "r_2": 4e-3}, {"l": 0.07}])
def test_a_dimer_of_another_shape_starts_with_its_lower_end_where_it_was(changes):
    run = simulate(periods=20)
    before = run.states(run.duration)
    again = simulate(start=run, **changes, periods=1)
    after, row = again.states(0), Parameters(**changes).row()
    lower = 1 if before["gap_1"] <= before["gap_2"] else 2
    assert after[f"gap_{lower}"].item() == before[f"gap_{lower}"].item()
    d = dimer_of(row)
    rise = after["gap_2"].item() - after["gap_1"].item()
    assert rise == pytest.approx(d.l * (sin(after["beta"].item()) - d.sin_0), abs=1e-15)
    dip = before["beta"].item() - dimer_of(Parameters().row()).beta_0
    assert after["beta"].item() - d.beta_0 == pytest.approx(dip, abs=1e-14)
    for name in ("theta", "beta_rate"):
        assert after[name].item() == pytest.approx(before[name].item(), abs=1e-12)
    np.testing.assert_allclose(across_and_axial(after), across_and_axial(before), atol=1e-12)
    assert again.error()["gap_1"].max() < 1e-5  # its shadows start from what it says of its start


@jit
def test_a_start_of_several_runs_is_refused():
    one, two = (simulate(e=e, periods=1).states(0.03) for e in (0.5, 0.6))
    both = xr.concat([one, two], "run")
    assert simulate(start=both.isel(run=0), periods=1).parameters["e"] == 0.5
    for start, message in ((both, r"start\.\w+: has 2 values"), (both.isel(run=1), "start: states of several runs")):
        with pytest.raises(ParameterError, match="^" + message):
            simulate(start=start, periods=1)
    xr.testing.assert_identical(both.isel(run=0), one)
    with pytest.raises(ParameterError, match=r"^phi0: given together with start.phase; leave one out$"):
        simulate(start=one, phi0=0.3, periods=1)


@pytest.mark.parametrize(("former", "now"), [("spin", "gamma"), ("spin_rate", "gamma_rate")])
def test_a_start_with_a_former_name_is_told_the_new_one(former, now):
    states = simulate(periods=2).states(0.1)
    assert now in states and former not in states
    for start in ({former: 1.0}, states.rename({now: former})):
        with pytest.raises(ParameterError, match=f"start.{former}: is {now} now; spin is gamma_rate"):
            simulate(start=start, periods=2)


def test_spin_is_the_axial_spin_in_all_that_has_one():
    run = simulate(periods=100)
    after = run.section("double_impact").isel(n=-1)
    axial = after["gamma_rate"] + after["theta_rate"] * np.sin(after["beta"])
    names = set(run.states(0.0).variables) | set(run.section().variables) | set(run.events.variables)
    assert not {"spin", "spin_rate"} & names
    assert run.orbit.spin == pytest.approx(axial.item(), rel=1e-4)  # the last impact of the burst comes after the first
    assert orbits.find(guess=run).spin == pytest.approx(run.orbit.spin, rel=1e-4)
    cube = sweep({"Gamma": [0.9]}, periods=100, progress=False)
    assert cube["spin"].item() == cube.dimersweep.run(Gamma=0.9).orbit.spin and "spin_rate" not in cube

"""Orbits as fixed points: against settled runs, long runs, the multipliers of stability and closed forms."""

import inspect

import numpy as np
import pytest
from numpy.testing import assert_allclose

import dimersweep
from dimersweep import orbits, simulate, stability, sweep
from dimersweep.analysis.orbits.continuation.kinds import change_of
from dimersweep.analysis.orbits.map import poincare
from dimersweep.analysis.orbits.map.finding import rolled_up
from dimersweep.errors import KernelError, OrbitError, ParameterError
from dimersweep.kernel.model.layout import IMPACT_STEPS, MAX_EVENTS, STATUS_MESSAGES
from dimersweep.parameters import Parameters
from tests.seams import begin_when_stopped

TOLD = ("radius", "period", "zeta", "speed", "precession_rate", "impact_phase")


@pytest.fixture(scope="module")
def drift():
    return simulate(periods=400, rtol=1e-11)


@pytest.fixture(scope="module")
def base():
    return orbits.find()


def test_the_package_reaches_orbits_lazily():
    assert dimersweep.orbits is orbits
    assert {"find", "follow", "border", "family", "later", "edge", "PeriodicOrbit"} <= set(dir(orbits))
    wanted = ("parameters", "spin", "radius", "period", "zeta", "speed", "precession_rate", "impact_phase", "di_end")
    wanted += ("spin_drift", "multipliers", "stable", "residual", "sequence", "run")
    known = set(orbits.PeriodicOrbit.__dataclass_fields__) | {n for n, _ in inspect.getmembers(orbits.PeriodicOrbit)}
    assert set(wanted) <= known


def test_an_orbit_closes_at_the_spin_a_lateral_start_rolls_up_to(base, drift):
    assert base.residual < 1e-11
    assert base.spin == pytest.approx(rolled_up(Parameters().given()), abs=1e-9)
    assert base.spin == pytest.approx(drift.orbit.spin, rel=1e-2)
    assert base.stable


def test_the_orbit_of_a_run_is_the_one_it_has_come_to(drift):
    found = orbits.find(guess=drift)
    assert found.residual < 1e-11
    assert found.cost <= 100
    assert found.spin == pytest.approx(drift.orbit.spin, rel=1e-5)
    again = orbits.find(guess=drift, spin=drift.orbit.spin)
    for name in TOLD:
        assert getattr(again, name) == pytest.approx(getattr(drift.orbit, name), rel=1e-5), name
    assert again.di_end == drift.orbit.di_end
    assert again.spin_drift < 0


@pytest.mark.parametrize("given", [{}, {"A_r": 5.0}, {"A_r": 7.0, "f": 20.0}, {"mu": 0.05, "mu_s": 0.1}])
def test_multipliers_are_those_of_stability(given):
    """Those of the fast part, and the slow one, which an orbit tells apart.

    With little friction the spin falls by a hundredth of a rad/s in the period that lies between the two.
    """
    run = simulate(**given, periods=600, rtol=1e-12, phi0=1.5 * np.pi, beta0=0.3)
    starts = iter(np.linspace(0.05, 1.0, 20))
    while run.mode != "drift":
        run = simulate(**given, periods=600, rtol=1e-12, phi0=1.5 * np.pi, beta0=next(starts))
    expected = stability.multipliers(run).values
    found = orbits.find(guess=run)
    slow = int(np.argmin(abs(expected - found.slow_multiplier)))
    assert expected[slow] == pytest.approx(found.slow_multiplier, abs=1e-6)
    fast = np.delete(expected, slow)
    size = max(fast.size, found.multipliers.size)
    padded = [np.pad(np.sort_complex(values), (0, size - values.size)) for values in (fast, found.multipliers)]
    assert_allclose(np.sort(np.abs(padded[0])), np.sort(np.abs(padded[1])), atol=1e-6 if "mu" not in given else 5e-6)


def test_the_slow_rate_is_that_of_a_long_run(base):
    short, long = (simulate(periods=n, record=False, rtol=1e-11).orbit.spin for n in (500, 1500))
    middle = orbits.find(spin=0.5 * (short + long))
    assert middle.spin_drift == pytest.approx((long - short) / 1000, rel=1e-5)
    assert middle.slow_multiplier == pytest.approx(1, abs=1e-5)


def test_the_orbit_does_not_depend_on_where_it_was_looked_for(base, drift):
    by_run = orbits.find(guess=drift, spin=base.spin)
    far = orbits.find(spin=60.0, Gamma=1.0)
    by_orbit = orbits.find(guess=far, Gamma=0.9, spin=base.spin)
    for other in (by_run, by_orbit):
        assert other.sequence == base.sequence
        for name in TOLD:
            assert getattr(other, name) == pytest.approx(getattr(base, name), rel=2e-6), name


def test_ends_of_their_own_take_the_place_of_what_the_guess_has(base):
    unlike = orbits.find(guess=base, e_1=0.58, e_2=0.62)
    assert unlike.parameters.items() >= {"e_1": 0.58, "e_2": 0.62}.items() and "e" not in unlike.parameters
    back = orbits.find(guess=unlike, e=0.6, spin=base.spin)
    assert back.parameters == base.parameters
    assert back.radius == pytest.approx(base.radius, rel=2e-6)
    with pytest.raises(ParameterError, match=r"^e: has no effect beside e_1 and e_2; leave one of the three out$"):
        orbits.follow(unlike, "e", to=0.7)


def test_a_planar_orbit_stays_in_its_plane():
    plane = orbits.find(spin=0.0)
    assert np.isnan([plane.radius, plane.period]).all() and "in a plane" in repr(plane)
    assert plane.precession_rate == 0.0
    assert abs(plane.spin) < 1e-30  # it begins beside the plane; what is left dies out from impact to impact
    assert plane.zeta == pytest.approx(np.pi)  # it drifts towards the end that is down
    run = simulate(xdot0=0.0, periods=300, rtol=1e-11)
    assert plane.speed == pytest.approx(run.orbit.speed, rel=1e-6)


def test_a_run_from_an_orbit_stays_on_it(base):
    run = base.run(40, rtol=1e-11)
    assert run.mode == "drift"
    assert run.parameters == base.parameters
    assert run.orbit.radius == pytest.approx(base.radius, rel=1e-5)
    assert run.orbit.spin == pytest.approx(base.spin + 39 * base.spin_drift, rel=5e-8)
    x = run.states([0.0, 1.0])
    assert float(abs(x.x[1] - x.x[0])) > 0.1  # it has a path


def test_an_unstable_orbit_is_found_and_left():
    flipped = orbits.find(spin=100.0, Gamma=1.3)
    assert not flipped.stable
    assert flipped.multipliers[0].real < -1
    assert flipped.run(200, rtol=1e-11).mode != "drift"


def test_twice_the_period():
    run = simulate(Gamma=1.28, beta0=0.3, periods=400, rtol=1e-11)
    values = iter(np.linspace(0.05, 1.2, 40))
    while run.mode_period != 2:
        run = simulate(Gamma=1.28, beta0=next(values), periods=400, rtol=1e-11)
    two = orbits.find(guess=run, periods=2)
    assert two.periods == 2
    assert two.stable
    one = orbits.find(spin=two.spin, Gamma=1.28)
    assert not one.stable
    with pytest.raises(OrbitError, match="repeats after 1"):
        orbits.find(spin=100.0, periods=2)


def test_the_orbit_that_runs_come_to_is_preferred_and_others_are_told():
    slender = {"r": 2.8107e-3, "A_r": 8.1917, "f": 15.558, "mu": 0.21445, "mu_s": 0.34869, "e": 0.73123, "Gamma": 0.82}
    orbit = orbits.find(spin=75.08, **slender)
    run = simulate(beta0=0.3, xdot0=75.08 * 2.8107e-3 * 1.4, periods=400, record=False, **slender)
    near = orbits.find(spin=run.orbit.spin, guess=orbit)
    assert near.radius == pytest.approx(run.orbit.radius, rel=1e-5)
    assert orbit.stable
    (other,) = orbit.others
    assert not other.stable
    assert other.spin == pytest.approx(orbit.spin)
    assert "1 other at this spin" in repr(orbit)
    assert orbits.find(spin=75.08, **slender | {"Gamma": 0.8}).others == ()
    assert orbits.find(spin=100.0, Gamma=1.28).others == ()  # it is found again from each start


def test_a_run_handed_in_gives_the_orbit_that_it_has_settled_on():
    """Its period is that of the motion, and its spin that of the run's end; so a point of a cube."""
    for given, period in (({"e": 0.66, "Gamma": 0.92}, 1), ({"Gamma": 1.275}, 2)):
        run = simulate(**given, periods=400)
        found = orbits.find(run)
        assert (found.periods, found.stable, found.residual < 1e-11) == (period, True, True)
        assert found.parameters == run.parameters
        assert found.spin == pytest.approx(run.section("double_impact")["gamma_rate"][-1].item(), rel=1e-3)
    assert orbits.find(found).periods == 2  # of an orbit, too
    drift = simulate(periods=200)
    assert orbits.find(drift).spin == pytest.approx(drift.orbit.spin, rel=1e-5)
    assert orbits.find(drift, Gamma=0.95).parameters == drift.parameters | {"Gamma": 0.95}
    cube = sweep({"f": [15, 20], "beta0": [0.1, 0.3]}, periods=200, progress=False)
    at = cube.dimersweep.run(f=20, beta0=0.3)
    assert orbits.find(cube.isel(f=1, beta0=1)).radius == orbits.find(at).radius == pytest.approx(at.orbit.radius, 1e-5)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"periods": 10},
            "(its motion is unresolved); let it go on, as by run.go_on(400); periods=1 looks near its end nonetheless",
        ),
        ({"periods": 200, "Gamma": 3.0}, "(its motion is aperiodic); periods=1 looks near its end nonetheless"),
        ({"periods": 60, "beta0": 0.1}, "(its motion is rest)"),
        ({"periods": 10, "max_seconds": 1e-9}, "(the run was stopped from outside, as where its time was up)"),
    ],
)
def test_a_run_that_has_settled_on_no_orbit_is_told(given, told, monkeypatch):
    if "max_seconds" in given:
        begin_when_stopped(monkeypatch)
    with pytest.raises(ParameterError) as refused:
        orbits.find(simulate(**given))
    assert str(refused.value) == f"guess: the run has settled on no orbit {told}"


def test_what_is_no_orbit_is_told_in_one_line():
    with pytest.raises(OrbitError, match=r"needs Gamma >= .* = 0.7854\); tried the ball's orbit"):
        orbits.find(Gamma=0.7)
    rest = simulate(beta0=0.02, periods=50)
    with pytest.raises(OrbitError, match="the end of the run"):
        orbits.find(guess=rest, periods=1)
    with pytest.raises(ParameterError, match="nothing was recorded"):
        orbits.find(guess=simulate(periods=50, record=False))


@pytest.mark.parametrize(("status", "error"), [(IMPACT_STEPS, KernelError), (MAX_EVENTS, OrbitError)])
def test_a_fault_of_the_kernel_is_not_taken_for_a_missing_orbit(monkeypatch, status, error):
    """A border has it as the status of a point."""
    monkeypatch.setattr(poincare, "images", lambda *_: (status, 1))
    with pytest.raises(error, match=STATUS_MESSAGES[status][:40]):
        orbits.find(spin=100.0)
    with pytest.raises(OrbitError) as told:
        orbits.border("fold", "Gamma", over={"e": [0.6]}, spin=100.0)
    assert (f"fault of the kernel: {STATUS_MESSAGES[status]}" in str(told.value)) == (error is KernelError)


def test_sequences_have_the_states_in_their_order(base):
    assert base.sequence == "DI_sp_sp>DI_sp_sk chatter.1 SC1_sk.1 SC1_sp.1 SC1_sk.1 SC1_sp.1 far.2"
    assert base.fixed.passage.sequence == base.sequence
    assert change_of("DI_sp_sp far.2", "DI_sp_sp far.1 far.2").name == "hop"
    assert change_of("DI_sp_sp>DI_sp_sk SC1_sk.1", "DI_sp_sp SC1_sk.1").name == "double_impact"
    assert change_of("DI_sp_sp SC1_sk.1", "DI_sp_sp FM SC1_sk.1").name == "lift_off"
    assert change_of("DI_sp_sp chatter.1 SC1_sk.1", "DI_sp_sp bounces.1*4").name == "chatter"
    assert change_of("DI_sp_sp SC1_sk.1", "DI_sp_sp SC1_sk.1 SC1_sp.1").name == "stick_slip"


@pytest.mark.parametrize("Gamma", [0.78, 0.6])
@pytest.mark.parametrize("periods", [1, 2])
def test_below_the_fold_it_is_said_why_there_is_no_orbit(Gamma, periods):
    """The ball has its orbit from 0.7854 on. A run there comes to rest on the plate, of which no period repeats."""
    with pytest.raises(
        OrbitError, match=r"needs Gamma >= .* = 0.7854\).*200 periods on: the motion dies: both ends stay"
    ):
        orbits.find(Gamma=Gamma, periods=periods, spin=100.0)
    assert simulate(Gamma=Gamma, periods=200, record=False).mode == "rest"


def test_a_dimer_that_is_thrown_off_from_rest_once_a_period_repeats_after_one():
    """Nothing of it is free at the section but its spin: the period that was asked for is refused in a line."""
    thrown = {"e": 0.3, "Gamma": 1.1, "spin": 0.0}
    assert orbits.find(**thrown).multipliers.tolist() == [0]
    with pytest.raises(OrbitError, match="repeats after 1 already; ask for periods=1"):
        orbits.find(**thrown, periods=2)


@pytest.mark.parametrize("given", [{"spin": 100.0}, {"spin": 100.0, "Gamma": 1.6}])
def test_an_orbit_shows_itself_in_a_notebook(given, tmp_path):
    orbit = orbits.find(**given)
    table = orbit._repr_html_()
    word = "stable" if orbit.stable else "unstable"
    for text in (f"Orbit: {word}", "100 rad/s", f"{orbit.radius:.6g} m", orbit.sequence.replace(">", "&gt;")):
        assert text in table
    assert ("the base case" in table) == orbit.stable
    figure = orbit.plot(tmp_path / "orbit.png")
    assert (tmp_path / "orbit.png").exists()
    assert figure.get_suptitle().startswith(f"{word} orbit of spin 100 rad/s: ")
    cycles, heights = figure.axes[0].lines[0].get_xydata().T  # it repeats: one that is unstable has not left yet
    assert_allclose(np.interp(cycles[:1000] + 1, cycles, heights), heights[:1000], atol=0.02)
    assert np.ptp(heights) > 5

"""Settled means that the fast part has settled: a motion whose spin drifts slowly has its mode, and that drift beside it."""

import numpy as np
import pytest

import dimersweep
from dimersweep import names, orbits, simulate
from tests.checks.data import data
from tests.checks.verdicts import strobes_of

pytestmark = pytest.mark.jit
MOTIONS = data("scenes")["motions"]
DRIFTING = [{"A_r": 5.0, "beta0": 0.3386, "xdot0": xdot0} for xdot0 in (2.5, 3.0)]


@pytest.fixture(scope="module", params=DRIFTING, ids=lambda scene: f"xdot0 = {scene['xdot0']}")
def drifting(request):
    return simulate(**request.param, periods=400)


def test_a_drift_whose_spin_drifts_slowly_is_a_drift(drifting):
    x, _ = strobes_of(drifting)
    late = slice(100, None)
    change = np.abs(np.diff(x, axis=0)).max(axis=1)
    assert (change[late] > 1e-4).all()  # by its strobes alone it would not have settled
    assert drifting.mode == "drift"
    assert drifting.mode_period == 1
    assert drifting.settled_after < 100
    assert drifting.spin_drift / drifting.orbit.spin < -2e-4


def test_the_slow_drift_is_that_of_the_family(drifting):
    """A run tells the pace over its last 20 periods, an orbit that of the next one."""
    orbit = orbits.find(guess=drifting)
    assert drifting.spin_drift == pytest.approx(orbit.spin_drift, rel=2e-2)


def test_the_slow_drift_is_the_change_of_the_spin():
    run = simulate(periods=300)
    earlier = simulate(periods=281, record=False)
    slope = (run.orbit.spin - earlier.orbit.spin) / 19
    assert run.spin_drift == run.orbit.spin_drift == pytest.approx(slope, rel=1e-5)


def test_the_slow_drift_of_a_motion_that_is_no_drift():
    run = simulate(Gamma=1.2, beta0=0.8, periods=100)
    assert run.mode == "jump"
    _, spin = strobes_of(run)
    span = 24 // run.mode_period * run.mode_period
    assert run.spin_drift == pytest.approx((spin[-1] - spin[-1 - span]) / span, rel=1e-6, abs=1e-10)
    assert np.isnan(simulate(Gamma=0.5, periods=100, record=False).spin_drift)


SWAYED = {"Gamma_x": 0.03}  # the heading drives its strobes, by more than its spin drifts slowly


def test_a_drift_whose_heading_is_driven_is_a_drift():
    """Its strobe follows the heading: at the same heading, one turn later, it is the same."""
    run = simulate(**SWAYED, periods=800)
    assert run.mode == "drift"
    assert run.mode_period == 1
    assert run.settled_after < 50
    x, _ = strobes_of(run)
    heading = run.section()["theta"].values[1:]
    late = slice(100, None)
    change = np.abs(np.diff(x, axis=0)).max(axis=1)
    assert (change[late] > 1e-4).mean() > 0.5  # by its strobes alone it would not have settled
    assert (change[late] < np.abs(np.diff(heading))[late]).all()
    again = np.argmin(np.abs(heading - (heading[100] - 2 * np.pi)))
    assert np.abs(x[again] - x[100]).max() < 0.1 * np.ptp(x[late], axis=0).max()


def test_a_heading_that_turns_is_followed_to_the_last_period_asked_for():
    """The pace of now says nothing of the turn to come, so that there is no early end but in rest."""
    run = simulate(**SWAYED, periods=300, record=False, stop_when_settled=True)
    assert run.mode == "drift"
    assert run.n_periods == 300
    assert run.change_ahead == 0
    resting = simulate(**SWAYED, beta0=0.15, Gamma=0.5, periods=300, record=False, stop_when_settled=True)
    assert resting.mode == "rest"
    assert resting.n_periods < 100


def test_a_fast_part_that_falls_is_foreseen():
    """At 60 periods the strobes have not repeated for 24 of them, but fall tenfold in 10; at 400 they are the same drift."""
    scene = {"e": 0.7, "beta0": np.radians(42), "rtol": 1e-6}
    early = simulate(**scene, periods=60)
    x, _ = strobes_of(early)
    change = np.abs(np.diff(x, axis=0)).max(axis=1)
    assert change[33] > 1e-4 > change[-1]
    late = simulate(**scene, periods=400, record=False)
    assert early.mode == late.mode == "drift"
    assert early.orbit.radius == pytest.approx(late.orbit.radius, rel=1e-3)


def test_a_drift_that_spirals_in_is_no_motion_of_three_periods():
    """Its fast part turns by a third with each period, so it comes near itself after three of them before it does after one."""
    run, seen = simulate(**MOTIONS["spirals in"], periods=50, record=False), set()
    while run.mode != "drift":
        seen.add(run.mode)
        run = run.go_on(1)
    assert run.n_periods < 150
    assert run.mode_period == 1
    assert seen <= {"unresolved", "aperiodic"}


def longest_flight(run, end, since):
    """Longest time from when an end leaves the plate to its next hit, or to the end of the run, in forcing periods."""
    events = names(run.events).to_dataframe().groupby("time", as_index=False).agg(
        {"contact_after": "last", f"impulse_{end}": "max"}
    )  # fmt: skip
    closed = events["contact_after"].str.startswith(("D", f"SC{end}"))
    hit = events[f"impulse_{end}"] > 0
    leaves = events["time"][(hit | closed.shift(fill_value=True)) & ~closed].to_numpy()
    lands = events["time"][hit | closed].to_numpy()  # a chatter ends where its bounces have accumulated
    lands = np.append(lands, run.duration)
    ends = lands[np.minimum(np.searchsorted(lands, leaves, side="right"), lands.size - 1)]
    hops = ends - leaves
    return float(hops[ends > since].max(initial=0.0)) * run.parameters["f"]


@pytest.mark.parametrize("scene", [{}, {"Gamma": 1.2}, {"Gamma": 1.2, "beta0": 0.8}, {"e": 0.8, "Gamma": 1.5}], ids=str)
def test_the_longest_hops_are_those_of_the_events(scene):
    run = simulate(**scene, periods=100)
    since = (100 - 12) / run.parameters["f"]
    for end, told in ((1, run.longest_hop_1), (2, run.longest_hop_2)):
        assert told == pytest.approx(longest_flight(run, end, since), abs=2e-2)  # a chatter's hops are summed


def test_the_orbits_of_r1_go_on_where_their_name_changes():
    """Beyond Gamma = sqrt(1 + (pi/2 - 2/pi)^2) p1 hops for longer than half a period, once in each: the name changes."""
    line = np.hypot(1.0, np.pi / 2 - 2 / np.pi)
    below, above = (
        orbits.find(e=0.5, Gamma=line + by, spin=100.0).run(100) for by in (-0.02, 0.03)
    )  # the line is that of a hop from rest
    assert below.mode == "drift"
    assert above.mode == "period_n"
    assert above.mode_period == 1
    assert below.longest_hop_1 < 0.5 < above.longest_hop_1 < 0.6


def test_a_cube_tells_the_slow_drift_and_the_hops():
    cube = dimersweep.sweep({"xdot0": [2.5, 3.0], "A_r": [5.0], "beta0": [0.3386]}, periods=200, progress=False)
    assert (names(cube["mode"]) == "drift").all()
    assert (cube["spin_drift"].values < 0).all()
    assert cube["spin_drift"].attrs["units"] == "rad s-1"
    assert (cube["longest_hop_1"].values < 0.5).all()


# --- the numbers of a run that stops --------------------------------------------------------------------------------------

WITHIN = 1e-3  # how far they may be from those of the periods asked for (docs/stopping.md)


def test_a_path_that_bends_less_and_less_is_followed_until_its_radius_stands():
    stopped, full = (
        simulate(**MOTIONS["straightens"], periods=300, record=False, stop_when_settled=settle)
        for settle in (True, False)
    )
    assert stopped.mode == full.mode == "drift"
    assert stopped.orbit.radius == pytest.approx(full.orbit.radius, rel=WITHIN)
    assert stopped.orbit.period == pytest.approx(full.orbit.period, rel=WITHIN)
    assert stopped.orbit.zeta == pytest.approx(full.orbit.zeta, abs=WITHIN)
    assert stopped.n_periods < 300
    assert full.change_ahead == 0.0
    assert 0.0 < stopped.change_ahead < WITHIN


@pytest.mark.parametrize("Gamma", np.linspace(0.3, 0.7, 5))
def test_a_run_that_dies_stops_with_the_period_in_which_both_ends_come_to_stick(Gamma):
    run = simulate(Gamma=Gamma, periods=100, stop_when_settled=True)
    assert run.mode == "rest"
    moves = names(run.events["contact_after"]).values != "DC_sk_sk"
    death = run.events["time"].values[np.flatnonzero(moves)[-1] + 1]
    assert run.n_periods == np.ceil(death * run.parameters["f"])


@pytest.mark.parametrize("periods", range(3, 20))
def test_shares_and_hops_of_a_rest_are_those_of_the_last_periods_asked_for(periods):
    stopped, full = (
        simulate(beta0=0.15, Gamma=0.6, periods=periods, record=False, stop_when_settled=settle)
        for settle in (True, False)
    )
    for name in ("down_share_1", "down_share_2", "longest_hop_1", "longest_hop_2"):
        assert getattr(stopped, name) == pytest.approx(getattr(full, name), abs=1e-12)


@pytest.mark.parametrize(
    "scene", [{"xdot0": 0.0}, {"xdot0": 0.0, "mu": 0.0, "mu_s": 0.0}], ids=["planar", "no friction"]
)
def test_a_straight_walk_stops_too(scene):
    run = simulate(**scene, periods=300, record=False, stop_when_settled=True)
    assert run.mode == "drift"
    assert run.n_periods < 150

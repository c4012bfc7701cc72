"""Settled means that the fast part has settled: a motion whose spin creeps has its mode, and the creep beside it."""

from typing import NamedTuple

import numpy as np
import pytest

import dimersweep
from dimersweep import orbits, simulate
from dimersweep.cubes.cube import blank, names
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import CODES, M_DRIFT, M_REST, OUT
from dimersweep.parameters import fill_rows
from dimersweep.symbols import BASE

pytestmark = pytest.mark.jit
CREEPING = [{"A_r": 5.0, "beta0": 0.3386, "xdot0": xdot0} for xdot0 in (2.5, 3.0)]


@pytest.fixture(scope="module", params=CREEPING, ids=lambda scene: f"xdot0 = {scene['xdot0']}")
def creeping(request):
    return simulate(**request.param, periods=400)


def strobes(run):
    """Gaps and gap rates at the ends of the periods in units of g and omega, and the spin [rad/s]."""
    f, g = run.parameters["f"], run.parameters["g"]
    omega = 2 * np.pi * f
    states = run.states(np.arange(1, run.n_periods + 1) / f)
    gaps = [states[name].values * omega**2 / g for name in ("gap_1", "gap_2")]
    rates = [states[name].values * omega / g for name in ("gap_1_rate", "gap_2_rate")]
    spin = states["gamma_rate"].values + states["theta_rate"].values * np.sin(states["beta"].values)
    return np.column_stack([*gaps, *rates]), spin


def test_a_drift_whose_spin_creeps_is_a_drift(creeping):
    x, _ = strobes(creeping)
    late = slice(100, None)
    change = np.abs(np.diff(x, axis=0)).max(axis=1)
    assert (change[late] > 1e-4).all()  # by its strobes alone it would not have settled
    assert creeping.mode == "drift"
    assert creeping.mode_period == 1
    assert creeping.settled_after < 100
    assert creeping.spin_drift / creeping.orbit.spin < -2e-4


def test_the_creep_is_that_of_the_family(creeping):
    """A run tells the pace over its last 20 periods, an orbit that of the next one."""
    orbit = orbits.find(guess=creeping)
    assert creeping.spin_drift == pytest.approx(orbit.spin_drift, rel=2e-2)


def test_the_creep_is_the_change_of_the_spin():
    run = simulate(periods=300)
    earlier = simulate(periods=281, record=False)
    slope = (run.orbit.spin - earlier.orbit.spin) / 19
    assert run.spin_drift == run.orbit.spin_drift == pytest.approx(slope, rel=1e-5)


def test_the_creep_of_a_motion_that_is_no_drift():
    run = simulate(Gamma=1.2, beta0=0.8, periods=100)
    assert run.mode == "jump"
    _, spin = strobes(run)
    span = 24 // run.mode_period * run.mode_period
    assert run.spin_drift == pytest.approx((spin[-1] - spin[-1 - span]) / span, rel=1e-6, abs=1e-10)
    assert np.isnan(simulate(Gamma=0.5, periods=100, record=False).spin_drift)


SWAYED = {"Gamma_x": 0.03}  # the heading drives its strobes, by more than its spin creeps


def test_a_drift_whose_heading_is_driven_is_a_drift():
    """Its strobe follows the heading: at the same heading, one turn later, it is the same."""
    run = simulate(**SWAYED, periods=800)
    assert run.mode == "drift"
    assert run.mode_period == 1
    assert run.settled_after < 50
    x, _ = strobes(run)
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
    x, _ = strobes(early)
    change = np.abs(np.diff(x, axis=0)).max(axis=1)
    assert change[33] > 1e-4 > change[-1]
    late = simulate(**scene, periods=400, record=False)
    assert early.mode == late.mode == "drift"
    assert early.orbit.radius == pytest.approx(late.orbit.radius, rel=1e-3)


SPIRALS = {
    "e": 0.8706502253165858,
    "Gamma": 0.8589557329585741,
    "f": 14.410795255447105,
    "A_r": 4.274531930838366,
    "mu": 0.23039298061938446,
    "mu_s": 0.2750809210437879,
    "beta0": 0.7012270466932967,
    "xdot0": 0.3616331296229325,
}


def test_a_drift_that_spirals_in_is_no_motion_of_three_periods():
    """Its fast part turns by a third with each period, so it comes near itself after three of them before it does after one."""
    run, seen = simulate(**SPIRALS, periods=50, record=False), set()
    while run.mode != "drift":
        seen.add(run.mode)
        run = run.go_on(1)
    assert run.n_periods < 150
    assert run.mode_period == 1
    assert seen <= {"unresolved", "aperiodic"}


def longest_flight(run, end, since):
    """Longest time from when an end leaves the plate to its next hit, in forcing periods."""
    events = run.events.to_dataframe().groupby("time", as_index=False).agg(
        {"contact_after": "last", f"impulse_{end}": "max"}
    )  # fmt: skip
    closed = events["contact_after"].str.startswith(("D", f"SC{end}"))
    hit = events[f"impulse_{end}"] > 0
    leaves = events["time"][(hit | closed.shift(fill_value=True)) & ~closed].to_numpy()
    lands = events["time"][hit | closed].to_numpy()  # a chatter ends where its bounces have accumulated
    back = np.searchsorted(lands, leaves, side="right")
    known = back < lands.size
    hops, ends = lands[back[known]] - leaves[known], lands[back[known]]
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


def test_a_cube_tells_the_creep_and_the_hops():
    cube = dimersweep.sweep({"xdot0": [2.5, 3.0], "A_r": [5.0], "beta0": [0.3386]}, periods=200, progress=False)
    assert (names(cube["mode"]) == "drift").all()
    assert (cube["spin_drift"].values < 0).all()
    assert cube["spin_drift"].attrs["units"] == "rad s-1"
    assert (cube["longest_hop_1"].values < 0.5).all()


# --- the numbers of a run that stops --------------------------------------------------------------------------------------

WITHIN = 1e-3  # how far they may be from those of the periods asked for (docs/stopping.md)
STRAIGHTENS = {  # its mode stands after 117 periods; its path bends less and less
    "r": 7.349e-3,
    "A_r": 8.2046,
    "f": 63.702,
    "e": 0.70744,
    "mu": 0.05213,
    "mu_s": 0.22302,
    "Gamma": 0.74303,
    "phi0": 3.93796,
    "beta0": 1.44462,
    "xdot0": -2.54057,
    "rho_r": 615.7,
    "rho_b": 4861.9,
    "D_r": 7.157e-3,
}
DRIFTING = {  # mu_s is given over mu, D_r over r
    "r": (2e-3, 10e-3),
    "A_r": (4.0, 8.0),
    "f": (12.0, 70.0),
    "e": (0.45, 0.85),
    "mu": (0.03, 0.35),
    "mu_s": (1.0, 4.0),
    "Gamma": (0.5, 1.3),
    "phi0": (0.0, 6.28),
    "beta0": (0.05, 1.5),
    "xdot0": (-3.0, 3.0),
    "rho_r": (300.0, 3000.0),
    "rho_b": (1000.0, 8000.0),
    "D_r": (0.2, 1.0),
}


class Outcomes(NamedTuple):
    """Numbers and codes of runs, by the names of the kernel."""

    out: dict
    codes: dict


def outcomes(rows, settle):
    out, codes = blank(len(rows))
    run_many(rows, 300, 1e-8, settle, out, codes)
    return Outcomes(dict(zip(OUT, out.T, strict=True)), dict(zip(CODES, codes.T, strict=True)))


@pytest.fixture(scope="module")
def both_ways():
    """Random runs to where they stop, and to their last period."""
    rng, n = np.random.default_rng(7), 900
    columns = {name: rng.uniform(*ends, n) for name, ends in DRIFTING.items()}
    columns["mu_s"] *= columns["mu"]
    columns["D_r"] *= columns["r"]
    rows = fill_rows(BASE | columns, n)
    return outcomes(rows, True), outcomes(rows, False)


def test_a_path_that_bends_less_and_less_is_followed_until_its_radius_stands():
    stopped, full = (
        simulate(**STRAIGHTENS, periods=300, record=False, stop_when_settled=settle) for settle in (True, False)
    )
    assert stopped.mode == full.mode == "drift"
    assert stopped.orbit.radius == pytest.approx(full.orbit.radius, rel=WITHIN)
    assert stopped.orbit.period == pytest.approx(full.orbit.period, rel=WITHIN)
    assert stopped.orbit.zeta == pytest.approx(full.orbit.zeta, abs=WITHIN)
    assert stopped.n_periods < 300
    assert full.change_ahead == 0.0
    assert 0.0 < stopped.change_ahead < WITHIN


def test_the_numbers_of_a_stopped_drift_are_those_of_the_periods_asked_for(both_ways):
    stopped, full = both_ways
    drifts = (stopped.codes["mode"] == M_DRIFT) & (full.codes["mode"] == M_DRIFT)
    assert drifts.sum() > 137
    assert np.median(stopped.codes["n_periods"][drifts]) < 120
    for name in ("radius", "period", "speed", "precession_rate", "spin"):
        np.testing.assert_allclose(stopped.out[name][drifts], full.out[name][drifts], rtol=WITHIN, err_msg=name)
    for name in ("zeta", "impact_phase", "longest_hop_1", "longest_hop_2"):
        apart = np.abs(stopped.out[name][drifts] - full.out[name][drifts])
        assert apart.max() < WITHIN, name


def test_modes_of_stopped_runs_hardly_ever_differ_from_those_of_the_periods_asked_for(both_ways):
    stopped, full = both_ways
    differ = stopped.codes["mode"] != full.codes["mode"]
    assert differ.sum() <= 2  # of 900: five of 4,000 do (docs/stopping.md)


def test_what_a_stopped_run_leaves_out_is_told(both_ways):
    stopped, full = both_ways
    made_all = stopped.codes["n_periods"] == 300
    told = stopped.out["change_ahead"]
    assert (told[made_all] == 0).all()
    assert (told[~made_all] < WITHIN).all()
    assert (full.out["change_ahead"] == 0).all()
    drifts = (stopped.codes["mode"] == M_DRIFT) & (full.codes["mode"] == M_DRIFT) & ~made_all
    for name in ("radius", "period", "speed", "spin"):
        apart = np.abs(stopped.out[name][drifts] / full.out[name][drifts] - 1.0)
        assert (apart <= 1.2 * told[drifts] + 1e-6).all(), name


def test_a_run_that_rests_does_so_in_the_periods_that_are_not_made(both_ways):
    stopped, full = both_ways
    rests = (stopped.codes["mode"] == M_REST) & (full.codes["mode"] == M_REST)
    assert rests.sum() > 100
    assert stopped.codes["n_periods"][rests].mean() < 50
    for name in ("down_share_1", "down_share_2", "longest_hop_1", "longest_hop_2"):
        np.testing.assert_allclose(stopped.out[name][rests], full.out[name][rests], atol=1e-12, err_msg=name)


@pytest.mark.parametrize("Gamma", np.linspace(0.3, 0.7, 5))
def test_a_run_that_dies_stops_with_the_period_in_which_both_ends_come_to_stick(Gamma):
    run = simulate(Gamma=Gamma, periods=100, stop_when_settled=True)
    assert run.mode == "rest"
    moves = run.events["contact_after"].values != "DC_sk_sk"
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

"""Branches and borders: the folds, flips and sequences they pass, against measured values, closed forms and long runs."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from dimersweep import names, orbits, simulate
from dimersweep.analysis.attractors.shares import border_between
from dimersweep.analysis.orbits.borders.bifurcation_curve import on_border
from dimersweep.analysis.orbits.borders.border_grid import outwards
from dimersweep.analysis.orbits.continuation import following
from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS, COMPLEX, ComplexPair, change_of
from dimersweep.analysis.orbits.map.ball import ball_flip, ball_fold
from dimersweep.analysis.orbits.map.finding import of_run
from dimersweep.analysis.orbits.map.lost import OrbitLost
from dimersweep.errors import OrbitError, ParameterError
from tests.checks.tables import multipliers

# at spin 100 rad/s, all else as in the base case; found with a prototype of its own
FOLDS = {0.5: 1.04771531, 0.6: 0.78725965, 0.7: 0.55603099}
FLIPS = {0.5: 1.468736, 0.6: 1.264428, 0.7: 1.115556}


@pytest.fixture(scope="module")
def orbit():
    return orbits.find(spin=100.0)


@pytest.fixture(scope="module")
def down(orbit):
    return orbits.follow(orbit, "Gamma", to=0.7)


@pytest.fixture(scope="module")
def up(orbit):
    return orbits.follow(orbit, "Gamma", to=1.3, switch=True)


@pytest.mark.parametrize(("kind", "known"), [("fold", FOLDS), ("flip", FLIPS)])
def test_borders_are_where_they_were_measured(kind, known):
    found = orbits.border(kind, "Gamma", over={"e": list(known)}, spin=100.0)
    assert (found["status"] == "ok").all()
    assert np.abs(found["Gamma"].values - list(known.values())).max() < 2e-6
    assert (found["residual"] < 1.1e-11).all()


@pytest.mark.parametrize("kind", ["hop", "double_impact", "chatter"])
def test_a_change_of_sequence_costs_little_and_lies_between_two(kind):
    e = np.linspace(0.56, 0.6, 9)
    curve = orbits.border(kind, "Gamma", over={"e": e}, spin=100.0)
    changes = curve.sizes.get("number", 1)  # the motion has two of chatter: of the end that is down, and of the bouncer
    assert np.median(curve["cost"].values) <= 150 * changes
    Gamma = float(curve["Gamma"][4])
    below, above = (orbits.find(spin=100.0, e=e[4], Gamma=Gamma + by).sequence for by in (-1e-6, 1e-6))
    assert change_of(below, above).name == kind
    assert np.abs(np.diff(curve["Gamma"].values, 4)).max() < 1e-5  # smooth: no point is another border's


def test_a_point_of_a_curve_begins_with_its_nearest_neighbours():
    """From A_r = 5 to 6 the step is far; along e it is short."""
    curve = orbits.border("flip", "Gamma", over={"A_r": [5.0, 6.0], "e": np.linspace(0.6, 0.64, 5)}, spin=100.0)
    assert np.median(curve["cost"].values[1]) <= 120


def test_a_curve_does_not_depend_on_where_it_is_looked_for(orbit):
    """The start has another e than the points."""
    found = orbits.border("fold", "Gamma", over={"e": [0.5, 0.7]}, spin=100.0, start=orbit)
    assert np.abs(found["Gamma"].values - [FOLDS[0.5], FOLDS[0.7]]).max() < 2e-6


def test_no_dimer_stands_steeper_than_it_is_long():
    m = orbits.find(spin=100.0).fixed.map
    z = np.zeros(m.free.size)
    z[0] = 1.5 * m.section.dm.l / m.section.units[0]
    for asked in (m.state, m.passage):
        with pytest.raises(OrbitLost, match="steep"):
            asked(z)


def test_a_curve_costs_little_and_does_not_depend_on_its_points():
    fine = orbits.border("fold", "Gamma", over={"e": np.linspace(0.5, 0.7, 21)}, spin=100.0)
    assert np.sort(fine["cost"].values)[:-3].max() <= 120
    assert float(fine["Gamma"].sel(e=0.6, method="nearest")) == pytest.approx(FOLDS[0.6], abs=5e-8)
    flips = orbits.border("flip", "Gamma", over={"e": np.linspace(0.6, 0.7, 11)}, spin=100.0)
    assert np.sort(flips["cost"].values)[:-3].max() <= 120
    assert float(flips["Gamma"].values[-1]) == pytest.approx(FLIPS[0.7], abs=2e-6)


def test_the_fold_of_a_long_light_rod_is_that_of_a_ball():
    """As A_r grows without bound and the rod is without mass, J_t tends to m h^2 and r/h to 0: the ends are two balls."""
    e = [0.5, 0.6, 0.7]
    away = []
    for A_r in (100.0, 1000.0, 10_000.0):
        found = orbits.border("fold", "Gamma", over={"e": e}, spin=1e-3, A_r=A_r, rho_r=0.0)
        away.append(np.abs(found["Gamma"].values - [ball_fold(k) for k in e]).max())
    assert away[-1] < 1e-8
    assert away[0] / away[1] == pytest.approx(100, rel=0.1)  # it falls with the square of the length


def test_a_flip_where_the_end_that_is_down_slips_is_nearly_that_of_a_ball():
    """With little friction p1 gives way only through the coupling of the normals."""
    found = orbits.border("flip", "Gamma", over={"e": [0.6]}, spin=100.0, mu=0.05, mu_s=0.1)
    assert float(found["Gamma"][0]) == pytest.approx(ball_flip(0.6), abs=3e-3)


def test_a_branch_goes_through_its_fold_and_back(down):
    kinds = list(names(down["special"]).values)
    fold = kinds.index("fold")
    assert float(down["Gamma"][fold]) == pytest.approx(FOLDS[0.6], abs=2e-7)
    assert kinds.count("fold") == 1
    assert down["stable"].values[: fold - 1].all()
    assert not down["stable"].values[fold + 1 :].any()
    assert down.attrs["end"].startswith("back")
    assert float(down["Gamma"][-1]) == pytest.approx(0.9, abs=1e-9)
    told = multipliers(down)[fold]
    assert np.abs(told - 1).min() < 1e-3


def test_an_orbit_on_its_border_of_stability_is_not_stable_however_its_multiplier_is_rounded(up, down):
    for kind in ("fold", "flip", "stable_to"):
        found = orbits.border(kind, "Gamma", over={"e": [0.5, 0.55, 0.6, 0.65, 0.7]}, spin=100.0)
        assert not found["stable"].values.any()
        assert found["loses_stability"].values.all()
    for branch in (up, down):
        assert not branch["stable"].values[np.isin(names(branch["special"]), ["fold", "flip"])].any()


def test_at_a_fold_in_a_plane_nothing_drifts_either():
    """There two multipliers are 1, of which one is that of the spin."""
    branch = orbits.follow(orbits.find(spin=0.0), "Gamma", to=0.7)
    assert (names(branch["special"]) == "fold").sum() == 1
    assert np.abs(branch["spin_drift"]).max() < 1e-30


def test_a_warm_point_of_a_branch_costs_at_most_forty_periods(down):
    cost = np.diff(down["cost"].values)
    plain = (down["special"].values[1:] == 0) & (down["special"].values[:-1] == 0)
    assert plain.sum() > 10
    assert cost[plain].max() <= 40


def test_sequences_change_where_they_are_said_to(down):
    """On either side of the change nearest to the base case the orbits have the sequences of the rows beside it."""
    at = int(np.flatnonzero(names(down["special"]).values == "word")[0])
    place = float(down["Gamma"][at])
    assert names(down["change"]).values[at] == "stick_slip"
    below, above = (orbits.find(spin=100.0, Gamma=place + by).sequence for by in (-1e-6, 1e-6))
    assert below == down["word"].values[at + 1]
    assert above == down["word"].values[at - 1]


def test_a_flip_leads_to_the_doubled_branch(up):
    flip = int(np.flatnonzero(names(up["special"]).values == "flip")[0])
    assert float(up["Gamma"][flip]) == pytest.approx(FLIPS[0.6], abs=1e-5)  # there the spin is held elsewhere
    assert np.abs(multipliers(up)[flip] + 1).min() < 1e-4
    assert (up["periods"].values[: flip + 1] == 1).all()
    assert (up["periods"].values[flip + 1 :] == 2).all()
    beyond = up.isel(point=slice(flip + 2, None))
    assert beyond["stable"].values.all()
    assert up.attrs["end"].startswith("to")


def apart(run, orbit, skip=0):
    """Greatest distance of the strobes of a run from those of an orbit, in g/omega^2 and g/omega."""
    omega = 2 * np.pi * run.parameters["f"]
    units = np.array([9.81 / omega**2, 9.81 / omega])
    T = 1 / run.parameters["f"]
    names = ["gap_2", "gap_2_rate"]
    runs = run.states(np.arange(skip, run.n_periods) * T)[names].to_array().values.T / units
    own = orbit.run(3, rtol=1e-11).states([T])[names].to_array().values.T / units
    return np.abs(runs - own).max(axis=1)


@pytest.mark.parametrize("Gamma", [FOLDS[0.6] + 1e-4, FLIPS[0.6] - 1e-4])
def test_runs_stay_on_the_orbits_just_inside_the_borders(Gamma):
    orbit = orbits.find(spin=100.0, Gamma=Gamma)
    run = orbit.run(2000, rtol=1e-10)
    later = orbits.find(spin=run.orbit.spin, Gamma=Gamma)
    assert max(apart(run, orbit, 0).min(), apart(run, later, 1990).max()) < 1e-2
    assert min(apart(run, orbit, 0).max(), apart(run, later, 0).max()) < 1e-2


def test_beyond_the_flip_a_run_goes_to_the_doubled_orbit():
    Gamma = FLIPS[0.6] + 1e-4
    orbit = orbits.find(spin=100.0, Gamma=Gamma)
    assert not orbit.stable
    run = orbit.run(3300, rtol=1e-10)
    two = orbits.find(guess=run, periods=2)
    assert two.stable
    odd, even = apart(run, two, 3298)
    assert min(odd, even) < 1e-2 < 2e-2 < max(odd, even)
    below = orbits.find(spin=two.spin, Gamma=Gamma - 4e-3)
    branch = orbits.follow(below, "Gamma", to=Gamma, switch=True)
    assert branch["periods"].values[-1] == 2
    assert float(branch["radius"][-1]) == pytest.approx(two.radius, rel=1e-4)
    assert branch["word"].values[-1] == two.sequence


def test_below_the_fold_a_run_leaves():
    orbit = orbits.find(spin=100.0, Gamma=FOLDS[0.6] + 1e-6)
    run = orbit.run(5)
    beyond = replace(orbit.fixed.map, parameters=run.parameters | {"Gamma": FOLDS[0.6] - 1e-4}, rtol=1e-10)
    moved, z = of_run(run, beyond)
    left = False
    for _ in range(3000):
        try:
            z = moved.passage(z).point
        except RuntimeError:
            left = True
            break
    assert left
    with pytest.raises(OrbitError):
        orbits.find(guess=orbit, Gamma=FOLDS[0.6] - 1e-4)


def test_a_curve_names_where_it_meets_other_borders():
    found = orbits.border("fold", "Gamma", over={"e": np.linspace(0.54, 0.57, 4)}, spin=100.0)
    assert list(found["meets"].values) == ["fold-stick_slip"]
    e = float(found["e_at_meeting"][0])
    sides = orbits.border("fold", "Gamma", over={"e": [e - 1e-4, e + 1e-4]}, spin=100.0)
    assert sides["word"].values[0] != sides["word"].values[1]


def test_a_change_of_sequence_is_followed():
    found = orbits.border("double_impact", "Gamma", over={"e": [0.6, 0.601]}, spin=100.0)
    assert (found["status"] == "ok").all()
    for e, Gamma in zip(found["e"].values, found["Gamma"].values, strict=True):
        below, above = (orbits.find(spin=100.0, e=e, Gamma=Gamma + by).sequence for by in (-1e-6, 1e-6))
        assert below.split()[0] != above.split()[0]


def test_a_branch_in_the_spin_and_one_in_the_length():
    base = orbits.find(spin=100.0)
    spins = orbits.follow(base, "spin", to=110.0)
    assert spins["spin"].values[-1] == pytest.approx(110.0)
    assert float(spins["radius"][-1]) == pytest.approx(orbits.find(spin=110.0).radius, rel=1e-5)
    lengths = orbits.follow(base, "A_r", to=5.8)
    assert float(lengths["radius"][-1]) == pytest.approx(orbits.find(spin=100.0, A_r=5.8).radius, rel=1e-5)


class KnownMap:
    """A map of the plane whose borders are known in closed form."""

    rtol, step = 1e-12, 1e-4

    def __init__(self, formula, a):
        self.formula, self.a = formula, a

    def images(self, points):
        return np.array([self.formula(self.a, *z) for z in points])


@dataclass(frozen=True, kw_only=True, eq=False)
class Tripling(ComplexPair):
    """A kind of border that the package does not have: a complex pair of multipliers turns by a third; its size is unknown."""

    def test(self, point):
        values = np.linalg.eigvals(point.matrix)
        pairs = values[values.imag > COMPLEX]
        return self.away(pairs)[np.argmax(np.abs(pairs))] if pairs.size else np.nan

    def multiplier(self, unknown):
        return unknown[0] * self.slope(unknown)

    def slope(self, unknown):
        return complex(np.exp(2j * np.pi / 3))

    def away(self, values):
        return np.angle(values) - 2 * np.pi / 3

    def unknown(self, value):
        return abs(value)


TRIPLING = Tripling(name="tripling", meaning="a pair of multipliers turns by a third", color="#cc79a7", marker="^")


def test_a_new_kind_of_border_is_one_object_that_is_registered(orbit, monkeypatch):
    monkeypatch.setitem(BORDER_KINDS, "tripling", TRIPLING)
    found = orbits.border("tripling", "Gamma", over={"e": [0.6, 0.62]}, spin=100.0)
    assert (found["status"] == "ok").all()
    assert np.angle(multipliers(found)).max(axis=1) == pytest.approx(2 * np.pi / 3, abs=1e-6)
    branch = orbits.follow(orbit, "Gamma", to=1.1, sequences=False)
    at = names(branch["special"]).values == "tripling"
    assert branch["Gamma"].values[at] == pytest.approx(found["Gamma"].values[:1], abs=1e-5)


@pytest.mark.parametrize(
    ("kind", "formula", "begin", "known"),
    [
        # Henon's map with b = 0.3: fold at a = -(1 - b)^2/4, flip at 3 (1 - b)^2/4
        ("fold", lambda a, x, y: (1 - a * x**2 + y, 0.3 * x), (2.6, 0.8, -0.11), -(0.7**2) / 4),
        ("flip", lambda a, x, y: (1 - a * x**2 + y, 0.3 * x), (0.9, 0.3, 0.4), 3 * 0.7**2 / 4),
        # Henon's map with b = -1 keeps areas, and triples at a = 5/4, x = 2/5, y = -x
        ("tripling", lambda a, x, y: (1 - a * x**2 + y, -x), (0.45, -0.42, 1.2), 1.25),
        # the delayed logistic map turns into a torus at a = 2, x = 1/2, by 60 degrees a step
        ("torus", lambda a, x, y: (a * x * (1 - y), x), (0.49, 0.49, 1.95), 2.0),
    ],
)
def test_borders_of_known_maps_are_found(kind, formula, begin, known):
    axis = SimpleNamespace(spin=0.0, scale=1.0, map_at=lambda m, value: KnownMap(formula, value))
    at = on_border((BORDER_KINDS | {"tripling": TRIPLING})[kind], axis, KnownMap(formula, begin[-1]), np.array(begin))
    assert at.y[-1] == pytest.approx(known, abs=1e-8)
    if kind == "torus":
        assert at.z == pytest.approx([0.5, 0.5], abs=1e-8)
        assert at.y[-2] == pytest.approx(np.pi / 3, abs=1e-8)
    if kind == "tripling":
        assert at.y[-2] == pytest.approx(1.0, abs=1e-8)


def test_a_grid_is_walked_from_its_middle_outwards():
    walk = outwards((3, 4, 2))
    assert len(set(walk)) == 24
    assert walk[0] == (1, 1, 0)
    for k, index in enumerate(walk[1:], 1):
        assert any(sum(abs(a - b) for a, b in zip(index, other, strict=True)) == 1 for other in walk[:k])


def test_bad_input_is_told(orbit):
    for begin, parameter, to, message in (
        (orbit, "gama", 1.0, "unknown parameter"),
        (orbit, "Gamma", 0.9, "must differ"),
        (simulate(periods=1), "Gamma", 1.0, "must be a PeriodicOrbit"),
    ):
        with pytest.raises(ParameterError, match=message):
            orbits.follow(begin, parameter, to=to)


@pytest.mark.slow
def test_a_point_that_fails_is_marked_and_the_rest_kept():
    """The curve of the hop ends on the fold at e = 0.393."""
    found = orbits.border("hop", "Gamma", over={"e": [0.45, 0.39]}, spin=100.0)
    assert found["status"].values[0] == "ok" != found["status"].values[1]
    assert np.isnan(found["Gamma"].values).tolist() == [False, True]


def test_a_line_that_is_not_reached_is_begun_anew():
    """The phases of the double impact change near 0.966 at A_r = 6 and near 1.189 at 7: no step leads across."""
    found = orbits.border("double_impact", "Gamma", over={"A_r": [6.0, 7.0], "e": [0.56, 0.57]}, spin=100.0)
    assert found["status"].values.tolist() == [["ok", "ok"], ["one of 2", "one of 2"]]
    alone = orbits.border("double_impact", "Gamma", over={"e": [0.56]}, spin=100.0, A_r=7.0)
    assert float(found["Gamma"][1, 0]) == pytest.approx(float(alone["Gamma"][0]), abs=1e-8)


UNLIKE = {"r_1": 5e-3, "r_2": 5.05e-3}  # p2 is one per cent larger, all else as in the base case; spin 100 rad/s
UNLIKE_FOLD, UNLIKE_FLIP = 0.7885477, 1.2658848


@pytest.mark.parametrize(("kind", "known"), [("fold", UNLIKE_FOLD), ("flip", UNLIKE_FLIP)])
def test_a_border_of_unlike_balls_is_where_runs_change(kind, known):
    """On the inner side a run stays on the orbit; beyond, it comes to rest, or to a motion of twice the period."""
    found = orbits.border(kind, "Gamma", over={"e": [0.6]}, spin=100.0, **UNLIKE)
    Gamma = float(found["Gamma"][0])
    assert Gamma == pytest.approx(known, abs=1e-7)
    outwards = -1 if kind == "fold" else 1
    inside = orbits.find(spin=100.0, Gamma=Gamma - outwards * 1e-3, **UNLIKE)
    run = inside.run(1000, rtol=1e-10)
    assert run.mode == "drift"
    assert run.orbit.radius == pytest.approx(orbits.find(guess=inside, spin=run.orbit.spin).radius, rel=1e-5)
    plate = UNLIKE | {"Gamma": Gamma + outwards * 1e-3}
    beyond = simulate(start=run.states(run.duration), periods=3000, rtol=1e-10, **plate)
    if kind == "fold":
        assert beyond.mode == "rest"
        with pytest.raises(OrbitError):
            orbits.find(guess=inside, Gamma=Gamma + outwards * 1e-3)
    else:
        assert beyond.mode_period == 2
        assert orbits.find(guess=beyond, periods=2).stable


def test_a_fold_whose_impact_lies_where_the_spin_is_put_back_is_found():
    """At e = 0.7 the double impact lies 4e-6 of a period beside it. A branch, where no spin is put back, has the same fold."""
    short = {"r": 0.003, "A_r": 26 / 6, "mu": 0.3, "f": 30.0}
    found = orbits.border("fold", "Gamma", over={"e": [0.65, 0.7, 0.75]}, **short)
    assert (found["status"] == "ok").all()
    for e, Gamma, phase in zip(found["e"].values, found["Gamma"].values, found["impact_phase"].values, strict=True):
        branch = orbits.follow(orbits.find(e=e, Gamma=Gamma + 0.1, **short), "Gamma", to=Gamma - 0.1, sequences=False)
        assert min(phase, 1 - phase) < 1e-3
        assert Gamma == pytest.approx(float(branch["Gamma"][names(branch["special"]).values == "fold"][0]), abs=1e-6)
    assert float(found["Gamma"][1]) == pytest.approx(0.560388, abs=1e-6)


def lost_at(monkeypatch, times):
    """Make the derivatives by the parameter fail for the first point of a branch, so many times."""
    left = [times]

    def point_of(*arguments):
        left[0] -= 1
        if left[0] >= 0:
            raise OrbitLost("the contact at the section changes")
        return found(*arguments)

    found = following.point_of
    monkeypatch.setattr(following, "point_of", point_of)


def test_a_branch_whose_first_section_has_no_derivatives_begins_in_another(monkeypatch, orbit):
    plain = orbits.follow(orbit, "Gamma", to=0.85)
    lost_at(monkeypatch, 1)
    branch = orbits.follow(orbit, "Gamma", to=0.85)
    assert branch.attrs["end"].startswith("to:")
    assert float(branch["zeta"][-1]) == pytest.approx(float(plain["zeta"][-1]), rel=1e-8)


def test_a_branch_that_has_derivatives_in_no_section_is_lost_at_its_beginning(monkeypatch, orbit):
    lost_at(monkeypatch, 1000)
    branch = orbits.follow(orbit, "Gamma", to=0.85)
    assert branch.attrs["end"] == "lost: the contact at the section changes"
    assert branch["Gamma"].values.tolist() == [0.9]
    assert border_between(orbit, "Gamma", 0.85) == (0.9, "lost")


def test_columns_of_tables_have_the_attributes_of_cf(orbit, down):
    for table in (down, orbits.border("fold", "Gamma", over={"e": [0.6]}, spin=100.0)):
        for name in ("Gamma", "radius", "multipliers_real"):
            assert set(table[name].attrs) <= {"units", "long_name", "valid_min", "valid_max"}, name
        assert table["radius"].attrs["valid_min"] == 0.0


@pytest.mark.parametrize(
    ("kind", "begin", "to", "multiplier", "within"), [("fold", 0.8, 0.78, 1.0, 2e-5), ("flip", 1.25, 1.28, -1.0, 1e-6)]
)
def test_a_border_on_a_branch_has_its_multiplier(kind, begin, to, multiplier, within):
    """At a fold two multipliers meet, as the root of the distance: so they are known less well there."""
    branch = orbits.follow(orbits.find(spin=100.0, Gamma=begin), "Gamma", to=to, sequences=False)
    at = names(branch["special"]).values == kind
    assert at.sum() == 1
    assert np.abs(multipliers(branch)[at] - multiplier).min() < within

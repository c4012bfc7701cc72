"""Attractors: mirrors and matching of made-up motions, families, shares and borders at the base."""

from statistics import NormalDist

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal

from dimersweep import attractors, names, orbits, plots, simulate, sweep
from dimersweep.analysis.attractors.shares import drawn_starts
from dimersweep.analysis.attractors.telling_apart import Attractor, distance, matched
from dimersweep.analysis.orbits.slow.features import (
    ALIKE_WITHIN,
    Carried,
    Features,
    Mirrors,
    apart,
    features_of_orbit,
    mirrors_of,
    shifted,
)
from dimersweep.errors import ParameterError, StoreError
from dimersweep.parameters import Parameters
from tests.checks.data import data
from tests.checks.tables import multipliers

BOTH = Mirrors(plane=True, ends=True)
STARTS = {"beta0": ("1 deg", "60 deg"), "phi0": (0.0, 6.28)}
MANY = {"beta0": ("1 deg", "89 deg"), "xdot0": (0.2, 2.0), "phi0": (0.0, 6.28)}


def motion(periods=1, seed=0, sequence="DI", spin=10.0):
    gaps = np.random.default_rng(seed).uniform(size=(periods, 8, 2))
    return Features(periods, sequence, spin, gaps, 0.3)


def attractor(features, mode="jump"):
    return Attractor(mode, np.array([0]), 0, features)


@pytest.fixture(scope="module")
def base():
    return attractors(STARTS, starts=60, seed=3, periods=300, confirm=600, progress=False)


@pytest.fixture(scope="module")
def over_gamma():
    return attractors(STARTS, starts=24, seed=1, over={"Gamma": [0.75, 0.95, 1.25, 1.35]}, periods=300, progress=False)


# ------------------------------------------------------------------------------------------------------------- matching


def test_pairs_have_the_least_sum_and_what_is_infinite_is_never_paired():
    inf = np.inf
    costs = np.array([[0.1, 0.2, inf], [0.15, 5.0, inf], [inf, inf, inf]])
    assert matched(costs) == {0: 1, 1: 0}
    assert matched(np.full((2, 3), inf)) == {}


def test_a_motion_is_its_mirror_image_and_its_other_beginnings():
    a = motion(periods=3)
    later = a._replace(gaps=np.roll(a.gaps, 2, axis=0))
    assert apart(a, later, Mirrors(False, False)) == 0.0
    swapped = later._replace(gaps=later.gaps[..., ::-1], turn=-a.turn)
    assert apart(a, swapped, BOTH) == 0.0
    assert apart(a, swapped, Mirrors(plane=True, ends=False)) > ALIKE_WITHIN
    far, image = shifted(a, swapped, BOTH)
    assert far == 0.0
    assert_allclose(image.gaps, a.gaps)
    assert apart(a, motion(periods=2), BOTH) == np.inf


def test_a_branch_that_has_joined_another_has_the_period_of_that():
    once = motion(periods=2)
    twice = once._replace(periods=4, gaps=np.concatenate([once.gaps, once.gaps]))
    assert (once.least_period(), twice.least_period()) == (2, 2)


def test_without_orbits_attractors_are_matched_by_period_sequence_and_mode():
    known = [attractor(motion(seed=1)), attractor(motion(seed=2, sequence="FM")), attractor(None, "rest")]
    new = [attractor(None, "rest"), attractor(motion(seed=3, sequence="FM")), attractor(motion(periods=2, seed=1))]
    costs = [[distance(old, one, "Gamma", 1.0, BOTH) for one in new] for old in known]
    assert matched(np.array(costs)) == {1: 1, 2: 0}


def test_the_ends_are_mirrors_of_each_other_only_where_they_are_alike():
    assert mirrors_of(Parameters().given(), True) == BOTH
    assert mirrors_of(Parameters().given(), False) == Mirrors(False, False)
    for unlike in ({"e_1": 0.5}, {"r_2": 4e-3}, {"k_ratio": 2.0}):
        assert mirrors_of(Parameters(**unlike).given(), True) == Mirrors(plane=True, ends=False)


# -------------------------------------------------------------------------------------------- the same attractor, elsewhere


@pytest.fixture(scope="module")
def drift():
    return orbits.find(spin=130.0)


@pytest.mark.parametrize("spin", [0.5, 20.0, 64.3, 270.0])
def test_a_drift_of_another_spin_is_the_same_attractor_and_one_beside_it_is_not(drift, spin):
    family = Carried(drift, [0.5, 275.0], BOTH)
    there = features_of_orbit(orbits.find(spin=spin), BOTH)
    assert family.apart(there) < 0.1 * ALIKE_WITHIN
    assert family.apart(there._replace(turn=there.turn + 2 * ALIKE_WITHIN)) > ALIKE_WITHIN
    assert family.apart(there._replace(spin=400.0)) == np.inf


def test_a_run_with_its_ends_changed_is_another_attractor_only_if_mirrors_do_not_count():
    lateral = {"beta0": [0.28, 0.28, -0.28], "xdot0": [1.0, -1.0, 1.0]}
    both = attractors(points=lateral, periods=300, progress=False)
    assert both["count"].values.tolist() == [3]
    # the second one spins backwards: it lies on the family of the first, which passes through the motion in a plane
    each = attractors(points=lateral, periods=300, mirror=False, progress=False)
    assert each["basin"].values.tolist() == [1, 1, 2]


def test_an_orbit_is_found_that_forgets_all_but_its_spin_while_both_ends_stay_down():
    run = simulate(e=0.2, Gamma=4.0, periods=600, stop_when_settled=True)
    orbit = orbits.find(guess=run, periods=6)
    assert orbit.multipliers.tolist() == [0]  # nothing but the spin is free at the section
    assert abs(orbit.multipliers).max() == 0
    again = orbit.run(18, rtol=1e-11)
    at_phase = again.states((np.arange(18) + 0.5) / 15.0)["gap_1"].values
    assert_allclose(at_phase[6:], at_phase[:12], atol=1e-7)
    for fewer in (1, 2, 3):
        assert np.abs(at_phase[fewer:] - at_phase[:-fewer]).max() > 1e-3


# --------------------------------------------------------------------------------------------------------------- the base case


def test_the_base_case_rests_or_drifts_as_a_sweep_of_the_same_starts_says(base):
    columns = {name: base[name].values for name in STARTS}
    cube = sweep(points=columns, periods=300, progress=False)
    modes = cube.dimersweep.modes().values
    assert base.attrs["cost"] == cube["n_periods"].sum()
    assert names(base["mode"]).values.tolist() == ["rest", "drift"]
    assert (names(base["mode"]).values[base["basin"].values - 1] == modes).all()
    assert base["count"].values.tolist() == [(modes == mode).sum() for mode in ("rest", "drift")]
    assert_allclose(base["share"], base["count"] / 60)
    for end in (base["share_low"], base["share_high"]):  # Wilson's score test just accepts them
        assert_allclose((base["share"] - end) ** 2, NormalDist().inv_cdf(0.975) ** 2 * end * (1 - end) / 60, rtol=1e-9)
    assert bool(base["confirmed"].all())


def test_intervals_have_the_confidence_that_is_asked_for():
    found = attractors({"beta0": ("1 deg", "60 deg")}, starts=20, seed=3, level=0.6, **ROW)
    for end in (found["share_low"], found["share_high"]):
        expected = NormalDist().inv_cdf(0.8) ** 2 * end * (1 - end) / 20
        assert_allclose((found["share"] - end) ** 2, expected, rtol=1e-9)
    assert (found["share_low"] < found["share"]).all() and (found["share"] < found["share_high"]).all()


def test_the_orbit_of_an_attractor_is_that_of_orbits_at_its_spin(base):
    one = base.sel(attractor=2)
    orbit = orbits.find(spin=float(one["spin"]))
    assert one["orbit"]
    assert one["stable"]
    assert one["word"] == orbit.sequence
    for name in ("radius", "period", "zeta", "speed"):
        assert_allclose(float(one[name]), getattr(orbit, name), rtol=1e-6)
    sizes = np.sort(np.abs(orbit.multipliers))
    assert_allclose(np.sort(np.abs(multipliers(one)))[-sizes.size :], sizes, atol=1e-5)
    assert np.isnan(base["radius"].sel(attractor=1))


def test_a_file_has_what_was_found_and_opens_again(base, tmp_path):
    path = tmp_path / "found.nc"
    found = attractors(STARTS, starts=60, seed=3, periods=300, confirm=600, out=path, progress=False)
    assert found.identical(base)
    with xr.open_dataset(path) as stored:
        stored.load()
    assert stored["multipliers_real"].values.tobytes() == multipliers(base).real.tobytes()
    assert stored["multipliers_imag"].values.tobytes() == multipliers(base).imag.tobytes()
    for name in set(base.variables):
        assert_array_equal(stored[name].values, base[name].values)
    assert len(plots.attractors(stored).axes[0].patches) == len(plots.attractors(base).axes[0].patches)
    with pytest.raises(StoreError, match="exists already"):
        attractors(STARTS, starts=60, periods=300, out=path, progress=False)
    with pytest.raises(ParameterError, match="table"):
        attractors(STARTS, starts=60, periods=300, out=tmp_path / "found.zarr", progress=False)


def test_a_seed_gives_the_same_starts_and_numbers_whatever_the_threads(base):
    again = attractors(STARTS, starts=60, seed=3, periods=300, confirm=600, workers=1, progress=False)
    assert again.identical(base)
    assert not np.array_equal(drawn_starts(STARTS, None, None, 60, 4)["beta0"], base["beta0"])


def test_at_one_set_of_parameters_five_attractors_are_told_apart_and_stay():
    drawn = drawn_starts(MANY, None, None, 40, 2)
    # one start for each attractor
    each = {name: column[[0, 1, 2, 13, 14, 20, 33, 37]] for name, column in drawn.items()}
    found = attractors(points=each, fixed={"e": 0.8, "Gamma": 1.0}, periods=500, confirm=1000, progress=False)
    kept = found.sel(attractor=found["confirmed"] & (found["periods"] > 0))
    assert kept.sizes["attractor"] >= 5
    assert {1, 2, 3} <= set(kept["periods"].values.tolist())
    assert found["confirmed"].sel(attractor=names(found["mode"]) == "rest").all()


FAMILIES = data("scenes")["families"]
SEQUENCES_OF_UNLIKE, STARTS_OF_UNLIKE = FAMILIES["of many sequences"].values()


def test_a_family_whose_sequence_changes_with_the_spin_is_one_attractor():
    found = attractors(points=STARTS_OF_UNLIKE, fixed=SEQUENCES_OF_UNLIKE, periods=300, progress=False)
    assert found["basin"].values.tolist() == [1, 1, 1, 1, 1, 2]
    each = [{name: column[k] for name, column in STARTS_OF_UNLIKE.items()} for k in range(5)]
    sequences = [orbits.find(guess=simulate(**SEQUENCES_OF_UNLIKE, **start, periods=300)).sequence for start in each]
    assert len(set(sequences)) >= 3


def test_motions_that_long_runs_bring_together_are_one_attractor():
    fixed, starts = FAMILIES["brought together"].values()
    found = attractors(points=starts, fixed=fixed, periods=300, progress=False)
    assert found["basin"].values.tolist() == [1, 1, 2]
    each = [{name: column[k] for name, column in starts.items()} for k in range(2)]
    soon, late = (
        [simulate(**fixed, **start, periods=n, record=False).orbit.radius for start in each] for n in (300, 10_000)
    )
    assert abs(soon[1] / soon[0] - 1) > 0.03
    assert late[1] == pytest.approx(late[0], rel=1e-4)


def test_over_a_parameter_a_family_whose_sequence_changes_keeps_its_number():
    fixed = {name: value for name, value in SEQUENCES_OF_UNLIKE.items() if name != "Gamma"}
    starts = {name: column[-4:] for name, column in STARTS_OF_UNLIKE.items()}
    found = attractors(points=starts, fixed=fixed, over={"Gamma": [0.9, 1.0]}, periods=300, progress=False)
    drifts = found.sel(attractor=(names(found["mode"]) == "drift").any("Gamma"))
    assert drifts.sizes["attractor"] == 2
    assert (drifts["count"] > 0).all()
    sequence = drifts["word"].isel(attractor=0).values
    assert sequence[0] != sequence[1]


# ------------------------------------------------------------------------------------------------------------- a release


ABOUT_16 = {"beta0": {"value": "16 deg", "within": "0.5 deg"}, "xdot0": {"value": 1, "within": 0.05}}
ROW = {"periods": 200, "progress": False}


def share_of_drifts(found):
    return found["share"].where(names(found["mode"]) == "drift", 0.0).sum().item()


def modes_of_starts(found):
    return names(found["mode"]).values[found["basin"].values - 1].tolist()


def test_a_release_is_drawn_within_its_tolerances():
    normal = {"value": "16 deg", "sigma": "0.5 deg"}
    columns = drawn_starts(ABOUT_16 | {"phi0": "any", "betadot0": {"value": 0.1, "within": 0}}, None, None, 4000, 1)
    beta = np.degrees(drawn_starts({"beta0": normal}, None, None, 4000, 1)["beta0"])
    for name, ends in {"beta0": np.radians([15.5, 16.5]), "xdot0": (0.95, 1.05), "phi0": (0, 2 * np.pi)}.items():
        assert ends[0] <= columns[name].min() < columns[name].max() <= ends[1]
        mean, apart = np.mean(ends), ends[1] - ends[0]
        assert abs(columns[name].mean() - mean) < 4 * apart / np.sqrt(12 * 4000)
        assert columns[name].std() == pytest.approx(apart / np.sqrt(12), rel=0.03)
    assert set(columns["betadot0"]) == {0.1}
    assert abs(beta.mean() - 16) < 4 * 0.5 / np.sqrt(4000)
    assert beta.std() == pytest.approx(0.5, rel=0.05)
    inside = np.abs(beta - 16) < 0.5
    assert inside.mean() == pytest.approx(0.683, abs=0.03)


def test_the_phase_of_the_plate_decides_a_release():
    known = attractors(ABOUT_16, starts=60, seed=1, **ROW)
    assert (share_of_drifts(known), float(known["share_low"][0])) == (1.0, pytest.approx(60 / (60 + 1.96**2), abs=1e-4))
    any_phase = attractors(ABOUT_16 | {"phi0": "any"}, starts=60, seed=1, **ROW)
    assert any_phase.identical(
        attractors(ABOUT_16 | {"phi0": ("0 deg", "360 deg")}, starts=60, seed=1, workers=1, **ROW)
    )
    plain = [
        simulate(**{name: float(any_phase[name][k]) for name in ("beta0", "xdot0", "phi0")}, periods=200, record=False)
        for k in range(60)
    ]
    assert modes_of_starts(any_phase) == [run.mode for run in plain]
    assert 0.15 < share_of_drifts(any_phase) < 0.4


def test_the_share_of_a_release_beside_an_edge_is_what_the_edge_says():
    inside, edge = np.radians(16), np.radians(15)
    for _ in range(12):  # the edge by halving, with runs
        middle = 0.5 * (inside + edge)
        walks = simulate(beta0=middle, periods=200, record=False).mode == "drift"
        inside, edge = (middle, edge) if walks else (inside, middle)
    even = attractors({"beta0": ("15 deg", "16 deg")}, starts=200, seed=4, **ROW)
    expected = (np.radians(16) - edge) / np.radians(1)
    assert abs(share_of_drifts(even) - expected) < 3 * np.sqrt(expected * (1 - expected) / 200)
    assert (even["beta0"].values[np.array(modes_of_starts(even)) == "drift"] > edge).all()
    sigma = np.radians(0.3)
    normal = attractors({"beta0": {"value": edge + 0.5 * sigma, "sigma": sigma}}, starts=200, seed=4, **ROW)
    expected = NormalDist().cdf(0.5)
    assert abs(share_of_drifts(normal) - expected) < 3 * np.sqrt(expected * (1 - expected) / 200)


def test_the_phase_of_a_plate_with_harmonics_may_be_any():
    waves = {"z": {1: (0.9, 0.0), 2: (0.05, 1.0), 3: (0.02, 0.3)}}
    found = attractors(ABOUT_16 | {"phi0": "any"}, {"harmonics": waves}, starts=40, seed=2, **ROW)
    walks = np.flatnonzero(np.array(modes_of_starts(found)) == "drift")
    t = np.linspace(0, 1 / 15, 33)

    def plate(run):
        return (run.states(t)["z1"] - run.states(t)["gap_1"]).values

    def later(phase):  # the plate's height as it is written, from a start at that phase
        angles = 2 * np.pi * 15 * t + phase
        sizes = ((1, 0.9, 0.0), (2, 0.05, 1.0), (3, 0.02, 0.3))
        return sum(size / k**2 * np.sin(k * angles + at) for k, size, at in sizes) * 9.81 / (2 * np.pi * 15) ** 2

    for k in walks[:6]:
        start = found.isel(start=k)
        run = simulate(start=start, periods=200)
        assert run.mode == "drift"
        height = later(float(start["phi0"]))
        assert_allclose(plate(run) - plate(run)[0], height - height[0], atol=1e-12)
    assert found["count"].sel(attractor=names(found["mode"]) == "drift").values.tolist() == [walks.size]


@pytest.mark.parametrize("starts", [400, pytest.param(2000, marks=pytest.mark.release)])
def test_shares_of_drawn_angles_are_those_of_the_fine_grid(starts):
    over, angles = {"f": [15, 20, 25]}, {"beta0": ("0.01 deg", "89.99 deg")}
    found = attractors(angles, starts=starts, seed=7, over=over, periods=400, progress=False)
    walk = found.sel(attractor=found["attractor"][(names(found["mode"]) == "drift").all("f")].item())
    grid = np.array([0.194, 0.278, 0.250])  # of the 4,499 angles of sweeps/fig07.toml
    assert (walk["share_low"].values < grid).all()
    assert (grid < walk["share_high"].values).all()


def test_over_the_intensity_the_drift_appears_at_the_fold_and_goes_at_the_flip_where_that_of_period_2_begins(
    over_gamma,
):
    modes = names(over_gamma["mode"])
    assert ((modes == "not_run") == (over_gamma["count"] == 0)).all()
    drifts = int(over_gamma["attractor"][(modes == "drift").any("Gamma")][0])
    assert (over_gamma["count"].sel(attractor=drifts) > 0).values.tolist() == [False, True, True, False]
    told = {
        (int(number), str(what)): (float(border), str(kind))
        for number, what, border, kind in zip(
            *(names(over_gamma)[name].values for name in ("changed", "what", "border", "border_kind")), strict=True
        )
    }
    double = int(over_gamma["attractor"][(over_gamma["periods"] == 2).any("Gamma")][0])
    for number, what, kind, k in (
        (drifts, "appears", "fold", 1),
        (drifts, "goes", "flip", 2),
        (double, "appears", "flip", 3),
    ):
        spin = float(over_gamma["spin"].sel(attractor=number)[k])
        expected = orbits.border(kind, "Gamma", over={"e": [0.6]}, spin=spin)["Gamma"].item()
        assert told[number, what] == (pytest.approx(expected, abs=1e-4), kind)
    assert (over_gamma["count"].sum("attractor") == 24).all()


def test_borders_that_lie_close_share_a_label_and_all_areas_are_named(over_gamma):
    found = (
        names(over_gamma)
        .isel(change=[0] * 6)
        .assign(
            border=("change", [0.9, 0.901, 0.902, 1.0, 1.1, 1.15]),
            border_kind=("change", ["fold", "flip", "fold", "word", "lost", "flip"]),
        )
    )
    found = found.assign_coords(Gamma=np.linspace(0.8, 1.3, found.sizes["Gamma"]))
    figure = plots.attractors(found)
    texts = figure.axes[0].texts
    assert [text.get_text() for text in texts] == ["fold, flip", "word", "lost", "flip"]
    assert {text.get_rotation() for text in texts} == {90.0}
    assert len(figure.legends[0].get_texts()) == found.sizes["attractor"]

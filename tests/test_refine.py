"""A refined map is the map of a whole fine grid, at a fraction of its runs."""

import os

import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep.cubes.cube import names
from dimersweep.kernel.model.layout import M_DRIFT, M_REST, OK
from dimersweep.storage.store import looked_at
from dimersweep.storage.tilestore import tiles_of, words_for
from dimersweep.studies.refine import Cell, cuts, refine
from dimersweep.studies.search import search, study_of
from tests.fakes import CODE, SLOT, banded_kernel, failing, forget_some, points_made, points_on_disk, same_bits
from tests.seams import rows_made, use_kernel

COARSE = {
    "e": {"start": 0.4, "stop": 0.8, "num": 5},
    "Gamma": {"start": 0.5, "stop": 1.5, "num": 6},
    "beta0": {"start": 0.05, "stop": 1.0, "num": 20},
}
FINE = {"e": 2, "Gamma": 6}
SETTINGS = {"over": "beta0", "halvings": {"e": 2, "Gamma": 4}, "periods": 5, "progress": False}


@pytest.fixture
def banded(monkeypatch):
    use_kernel(monkeypatch, banded_kernel)


@pytest.fixture(scope="module")
def reference():
    """The map that most tests make in some other way."""
    with pytest.MonkeyPatch.context() as patch:
        use_kernel(patch, banded_kernel)
        return refine(COARSE, workers=2, **SETTINGS)


def brute_regions(grid, **settings):
    """Regions from every run of `grid`, and the number of those runs."""
    modes = names(dimersweep.sweep(grid, **({"periods": 5, "progress": False} | settings))["mode"])
    rest = xr.where((modes == "rest").all("beta0"), "rest", "other")
    return xr.where((modes == "drift").any("beta0"), "drift", rest), modes.size


def lumped(cube):
    region = names(cube["region"])
    return region.where(region.isin(["drift", "rest"]), "other")


def test_a_refined_map_is_the_map_of_the_whole_grid(banded):
    cube = refine(COARSE, between=["drift", "rest"], **(SETTINGS | {"halvings": FINE}))
    regions, size = brute_regions(COARSE | {name: cube[name].values for name in ("e", "Gamma")})
    xr.testing.assert_equal(lumped(cube), regions)
    assert set(np.unique(regions)) == {"drift", "rest", "other"}
    assert cube["n_runs"].sum() < size / 10
    computed = cube["computed"] == 1
    assert 0.05 < computed.mean() < 0.3
    assert (cube["n_runs"].where(~computed, 0) == 0).all()


@pytest.mark.jit
@pytest.mark.slow
def test_the_real_map_agrees_point_by_point_with_an_eighth_of_the_runs():
    grid = {"e": [0.65, 0.7], "Gamma": [0.5, 0.9], "beta0": {"start": 4, "stop": 80, "num": 4, "unit": "deg"}}
    cube = refine(grid, between=["drift", "rest"], **(SETTINGS | {"halvings": {"Gamma": 8}, "periods": 100}))
    fine = grid | {"Gamma": cube["Gamma"].values}
    regions, size = brute_regions(fine, periods=100)
    xr.testing.assert_equal(lumped(cube), regions)
    assert len(np.unique(regions)) > 1
    assert cube["n_runs"].sum() < size / 8


@pytest.mark.parametrize("workers", [1, 4])
def test_threads_change_nothing(banded, reference, workers):
    xr.testing.assert_equal(refine(COARSE, workers=workers, **SETTINGS), reference)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.release)])
def test_what_was_known_before_changes_nothing(banded, reference, tmp_path, seed):
    out = tmp_path / "map.nc"
    refine(COARSE, out=out, keep_tiles=True, **SETTINGS)
    with looked_at(tiles_of(out)) as store:
        configuration, done = store.configuration, points_on_disk(out)
        assert words_for(store, done) == f"{done} of {done} points known to be needed so far"
    coarse = study_of(COARSE, None, over="beta0", ask="any", mode="drift", periods=5, rtol=1e-8)
    forget_some(out, configuration, coarse.kind, seed)
    xr.testing.assert_equal(refine(COARSE, out=out, **SETTINGS), reference)
    assert os.listdir(tmp_path) == ["map.nc"]


def test_a_map_is_extended_to_the_bits_of_a_new_one(banded, monkeypatch, tmp_path):
    """From a search on its coarse grid, and from a map that is coarser, on fewer values and told apart otherwise."""
    gammas = np.linspace(0.5, 1.5, 6)
    grid, fewer = COARSE | {"Gamma": gammas}, COARSE | {"Gamma": gammas[1:]}
    half = SETTINGS | {"halvings": {"e": 1, "Gamma": 3}, "between": ["drift", "rest"]}
    former = {
        "coarse.nc": search(grid, out=tmp_path / "coarse.nc", over="beta0", periods=5, progress=False),
        "half.nc": refine(fewer, out=tmp_path / "half.nc", **half),
    }
    reference, made = refine(grid, **SETTINGS), rows_made(monkeypatch, banded_kernel)
    for name, known in former.items():
        made.clear()
        cube = refine(grid, extend=tmp_path / name, **SETTINGS)
        assert same_bits(cube, reference)
        free = known["n_runs"].where(known["beta0"].isnull(), 0)  # every run was made: no neighbour has led anywhere
        needed = free.where(reference["computed"].sel(e=known["e"], Gamma=known["Gamma"]) == 1, 0)
        assert 0.05 * reference["n_runs"].sum() < needed.sum() <= reference["n_runs"].sum() - points_made(made)


def test_a_retry_gives_the_bits_of_a_map_without_failures(banded, reference, monkeypatch, tmp_path):
    fails = failing(lambda rows: np.abs(rows[:, SLOT["e_1"]] - 0.6) < 1e-9, banded_kernel)
    with monkeypatch.context() as patch:
        use_kernel(patch, fails)
        refine(COARSE, out=tmp_path / "map.nc", **SETTINGS)
    cube = refine(COARSE, out=tmp_path / "map.nc", retry=True, **SETTINGS)
    assert same_bits(cube, reference)
    written = (tmp_path / "map.nc").stat().st_mtime_ns
    refine(COARSE, out=tmp_path / "map.nc", retry=True, **SETTINGS)
    assert (tmp_path / "map.nc").stat().st_mtime_ns == written, "nothing failed any more"


def test_regions_that_are_not_told_apart_cost_nothing(banded, reference):
    drift = refine(COARSE, between=["drift"], **SETTINGS)
    assert drift["computed"].sum() < reference["computed"].sum()
    xr.testing.assert_equal(names(drift["region"]) == "drift", names(reference["region"]) == "drift")


def test_a_refined_map_is_written_and_read_back(banded, tmp_path):
    cube = refine(COARSE, out=tmp_path / "map.nc", **SETTINGS)
    xr.testing.assert_identical(dimersweep.open_cube(tmp_path / "map.nc"), cube)


def test_cells_are_cut_along_the_axes_on_which_they_disagree():
    labels = np.full((3, 5), -1)
    labels[::2, ::4] = [[1, 1], [2, 2]]
    cell = Cell((0, 0), (2, 4))
    assert cuts([cell], labels) == {cell: {0}}
    columns = cell.halves({0})
    assert columns == [Cell((0, 0), (1, 4)), Cell((1, 0), (1, 4))]
    labels[1, ::4] = 2
    assert cuts(columns, labels) == {}  # the two sides of the first one differ, but neither of them changes
    labels[0, 2] = 2  # known from a neighbour
    assert cuts(columns, labels) == {columns[0]: {1}}
    labels[2, 4] = 1
    assert cuts([cell], labels) == {cell: {0, 1}}
    assert Cell((0, 4), (1, 4)).corners() == [(0, 4), (0, 8), (1, 4), (1, 8)]


def test_cells_that_touch_a_border_are_brought_to_the_size_of_its_cells():
    labels = np.full((2, 17), -1)
    labels[:, ::4], labels[:, 12:] = 1, 2
    before, torn, after = [Cell((0, o), (1, n)) for o, n in ((0, 8), (8, 4), (12, 4))]
    assert cuts([before, torn, after], labels) == {before: {1}, torn: {1}}
    labels[:, 10] = 1
    left, right = torn.halves({1})
    beside, far = Cell((0, 4), (1, 4)), Cell((0, 0), (1, 4))
    assert cuts([far, beside, left, right, after], labels) == {right: {1}, after: {1}}
    labels[:, 11] = 1  # the border is found, between 11 and 12
    halves = [*right.halves({1}), *after.halves({1})]
    assert cuts([far, beside, left, *halves], labels) == {Cell((0, 12), (1, 2)): {1}}


def test_an_island_beside_a_border_is_seen(monkeypatch):
    """One point of drift, with rest between it and the border, as in Fig. 8 at e = 0.7333."""

    def island_kernel(rows, periods, rtol, settle, out, codes, until=0, space=None):
        place = np.rint((rows[:, SLOT["Gamma"]] - 0.5) / (0.2 / 64)).astype(int)
        codes[:, CODE["status"]] = OK
        codes[:, CODE["mode"]] = np.where((place == 90) | (place >= 92), M_DRIFT, M_REST)
        return len(rows)

    use_kernel(monkeypatch, island_kernel)
    cube = refine(COARSE, **(SETTINGS | {"halvings": FINE}))
    drift = np.flatnonzero((names(cube["region"]) == "drift").isel(e=0))
    np.testing.assert_array_equal(drift, [90, *range(92, cube["Gamma"].size)])
    assert cube["computed"].mean() < 0.2

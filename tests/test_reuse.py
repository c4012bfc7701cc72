"""A cube is extended, and its failed points are run again, without running any other point twice."""

import os
import shutil

import numpy as np
import pytest
import xarray as xr
import zarr

import dimersweep
from dimersweep.cubes.cube import names
from dimersweep.errors import ParameterError, StoreError
from dimersweep.kernel.model.layout import ROW_BETA0
from dimersweep.storage.checking import checksum_of
from dimersweep.storage.cubefiles import open_cube
from dimersweep.studies.declared import from_cube
from dimersweep.studies.refine import refine
from dimersweep.studies.reuse import _places
from dimersweep.studies.search import search
from tests.fakes import failing, fake_run_many, points_made, same_bits
from tests.seams import another_version, use_kernel

BETA0 = np.linspace(0.1, 1.5, 29)
GRID = {"f": [15, 25], "beta0": BETA0}


pytestmark = pytest.mark.usefixtures("empty_folder")


def sweep(grid=GRID, fixed=None, **settings):
    return dimersweep.sweep(grid, fixed, **({"periods": 5, "progress": False} | settings))


@pytest.fixture(scope="module")
def put(tmp_path_factory):
    """Put a copy of the cube that a function makes at a path, and return the cube; each is made once."""
    folder, made = tmp_path_factory.mktemp("made"), {}

    def write(make, out):
        file = folder / f"{make.__name__}{os.path.splitext(out)[1]}"
        if file not in made:
            with pytest.MonkeyPatch.context() as patch:
                use_kernel(patch, fake_run_many)
                made[file] = make(out=file).load()
        (shutil.copytree if file.is_dir() else shutil.copy)(file, out)
        return made[file]

    return write


@pytest.mark.parametrize(
    ("grid", "fixed", "new"),
    [
        ({"f": [15, 20, 25], "beta0": BETA0}, {}, 29),  # a value between
        ({"f": [15, 25], "beta0": np.append(BETA0, 1.55)}, {}, 2),  # a value after
        ({"f": [15, 25], "beta0": np.sort(np.append(BETA0, BETA0[1:] - 0.02))}, {}, 56),  # values between all
        ({"f": [15, 25], "Gamma": [0.8, 0.9], "beta0": BETA0}, {}, 58),  # an axis that was a fixed value
        ({"beta0": BETA0}, {"f": 25}, 0),  # a fixed value that was an axis
        ({"beta0": BETA0[:5], "f": [15, 16]}, {}, 5),  # another order, and fewer values
        (GRID, {}, 0),
    ],
)
def test_points_of_a_cube_are_taken_over(put, asked, grid, fixed, new):
    put(sweep, "old.nc")
    reference = sweep(grid, fixed)
    asked.clear()
    cube = sweep(grid, fixed, extend="old.nc", out="new.nc")
    assert points_made(asked) == new
    xr.testing.assert_equal(cube, reference)
    assert same_bits(cube, reference)
    assert cube.attrs["extends"].startswith("old.nc, configuration sha256 ")
    asked.clear()
    xr.testing.assert_equal(sweep(grid, fixed, extend="old.nc"), reference)
    assert points_made(asked) == new


def test_values_match_bit_for_bit_or_not_at_all(put, asked):
    put(sweep, "old.nc")
    moved = BETA0.copy()
    moved[3] = np.nextafter(moved[3], 2)
    sweep({"f": [15, 25], "beta0": moved}, extend="old.nc")
    assert points_made(asked) == 2
    assert {row[ROW_BETA0] for rows in asked for row in rows} == {moved[3]}


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"periods": 6}, "  periods: 5 -> 6"),
        ({"rtol": 1e-6}, "  rtol: 1e-08 -> 1e-06"),
        ({"stop_when_settled": False}, "  stop_when_settled: true -> false"),
        ({"fixed": {"mu": 0.1}}, "  fixed.mu: 0.2 -> 0.1"),
        (
            {"grid": {"beta0": BETA0, "e_1": [0.5]}, "fixed": {"f": 15}},
            "  parameters: e, e_1, e_2 in one of them only",
        ),
    ],
)
def test_a_cube_made_otherwise_is_not_extended(put, asked, settings, told):
    put(sweep, "old.nc")
    with pytest.raises(StoreError) as error:
        sweep(**{"extend": "old.nc", "out": "new.nc"} | settings)
    first, *changes = str(error.value).splitlines()
    assert first == "old.nc: cannot be extended to this sweep, as it was made otherwise:"
    assert told in changes
    assert (asked, os.listdir()) == ([], ["old.nc"])


def test_a_cube_of_another_kernel_is_not_extended(put, asked, monkeypatch):
    put(sweep, "old.nc")
    another_version(monkeypatch)
    with pytest.raises(
        StoreError, match=r"otherwise:\n  kernel_version: the sources of dimersweep are those of another"
    ):
        sweep(extend="old.nc")


def test_a_cube_without_any_of_the_points_is_refused(put, asked):
    put(sweep, "old.nc")
    with pytest.raises(StoreError, match=r"^old.nc: has no point of this sweep \(f has none of its values\)$"):
        sweep({"f": [16, 17], "beta0": BETA0}, extend="old.nc")


def test_failed_points_are_run_again(monkeypatch, asked):
    reference = sweep()
    with monkeypatch.context() as patch:
        use_kernel(patch, failing(lambda rows: rows[:, ROW_BETA0] > 1.3))
        cube = sweep(out="cube.nc")
    failed = int((names(cube["mode"]) == "failed").sum())
    assert failed == 8
    asked.clear()
    assert sweep(out="cube.nc")["mode"].equals(cube["mode"])  # not without being asked
    assert points_made(asked) == 0
    again = sweep(out="cube.nc", retry=True)
    assert points_made(asked) == failed
    xr.testing.assert_equal(again, reference)
    xr.testing.assert_equal(dimersweep.open_cube("cube.nc"), reference)
    asked.clear()
    sweep(out="cube.nc", retry=True)
    assert points_made(asked) == 0


def test_a_stopped_sweep_runs_its_failed_points_again(monkeypatch, asked):
    reference = sweep()
    with monkeypatch.context() as patch, pytest.raises(dimersweep.errors.PointError):
        use_kernel(patch, failing(lambda rows: rows[:, ROW_BETA0] > 1.3))
        sweep(out="cube.nc", fail_fast=True, workers=1)
    assert os.listdir() == ["cube.nc.tiles"]
    xr.testing.assert_equal(sweep(out="cube.nc", retry=True), reference)


def test_retry_needs_a_cube(asked):
    sweep(out="cube.nc", retry=True)  # nothing is there yet: a first try
    with pytest.raises(StoreError, match=r"cube.nc: exists already; .*What differs:\n  periods: 5 -> 6"):
        sweep(out="cube.nc", retry=True, periods=6)


def a_sweep(**options):
    return sweep({"f": [15, 20, 25], "beta0": BETA0[:5]}, **options)


def a_search(**options):
    return search({"f": [0.3, 1, 3], "beta0": BETA0}, over="beta0", periods=5, progress=False, **options)


def a_map(**options):
    grid = {"f": [0.3, 1, 3], "beta0": BETA0}
    return refine(grid, over="beta0", halvings={"f": 3}, periods=5, progress=False, **options)


def points_of_a_table(**options):
    return sweep(None, points={"f": [15, 20, 25], "beta0": [0.05, 0.4, 0.2]}, **options)


def moved(cube, by):
    """Its first axis moved; of a table of points, its frequencies."""
    return cube.assign_coords(f=cube["f"].copy(data=cube["f"].values + by))


def swapped(cube):
    """Two of its points change places, but not their coordinates."""
    order = np.arange(cube["mode"].shape[0])
    order[:2] = 1, 0
    dim = cube["mode"].dims[0]
    return cube.isel({dim: order}).assign_coords({name: cube[name] for name in cube.coords if dim in cube[name].dims})


CHANGES = {
    "cut": lambda cube: cube.isel({cube["mode"].dims[0]: slice(0, 2)}),
    "moved": lambda cube: moved(cube, 1.0),
    "moved by a bit": lambda cube: moved(cube, 1e-15 * cube["f"].values),
    "reversed": lambda cube: cube.isel({cube["mode"].dims[0]: slice(None, None, -1)}),
    "turned": lambda cube: cube.expand_dims("e", axis=1) if cube["mode"].ndim == 1 else cube.transpose(),
    "swapped": swapped,
    "one value": lambda cube: cube.assign(n_events=cube["n_events"] + (cube["mode"] == cube["mode"].values.flat[0])),
    "less": lambda cube: cube.drop_vars("n_events"),
}


def rewrite(path, change):
    """What a user does to a cube with xarray."""
    engine = "zarr" if path.endswith(".zarr") else "netcdf4"
    how = {"consolidated": False} if engine == "zarr" else {}
    with xr.open_dataset(path, engine=engine, **how) as file:
        cube = change(file.load())
    if engine == "zarr":
        shutil.rmtree(path)
        with zarr.config.set({"array.write_empty_chunks": True}):
            cube.drop_encoding().to_zarr(path, consolidated=False, zarr_format=3)
    else:
        cube.to_netcdf(path)


MAKERS = (a_sweep, a_search, a_map, points_of_a_table)
SOME = {"cut", "turned", "swapped"}  # a length, the axes, the values


@pytest.mark.parametrize(
    ("make", "out", "change"),
    [
        *((a_sweep, "c.nc", change) for change in CHANGES),
        *((make, "c.nc", change) for make in MAKERS[1:] for change in sorted(SOME)),
        *(
            pytest.param(make, "c.nc", change, marks=pytest.mark.release)
            for make in MAKERS[1:]
            for change in sorted(CHANGES.keys() - SOME)
        ),
        (a_sweep, "c.zarr", "swapped"),
        *(pytest.param(a_sweep, "c.zarr", change, marks=pytest.mark.release) for change in sorted(SOME - {"swapped"})),
    ],
)
def test_a_cube_that_its_user_has_changed_is_not_taken_for_the_one_that_was_written(put, asked, make, out, change):
    put(make, out)
    rewrite(out, CHANGES[change])
    changed = "is (a cube (of dimersweep that was changed|whose)|damaged)"
    refused = rf"^(out = {out}: exists already, and cannot be used \()?{out}: {changed}"
    uses = [{"out": out}, {"extend": out}]
    uses += [{"out": out, "retry": True}, {"extend": out, "out": "d.nc"}] if change == "swapped" else []
    if make is points_of_a_table:
        uses = [each for each in uses if "extend" not in each]
    for use in uses:
        with pytest.raises(StoreError, match=refused) as error:
            make(**use)
        assert "\n" not in str(error.value)
    assert not asked and os.listdir() == [out]


@pytest.mark.parametrize(("make", "out"), [*((make, "c.nc") for make in MAKERS), (a_sweep, "c.zarr")])
def test_a_cube_that_was_written_again_as_it_was_is_taken(put, asked, make, out):
    reference = put(make, out)
    rewrite(out, lambda cube: cube[sorted(cube.data_vars)].assign_attrs(note="mine"))
    xr.testing.assert_equal(make(out=out), reference)
    assert not asked
    if make is not points_of_a_table:
        xr.testing.assert_equal(make(extend=out), reference)


@pytest.mark.parametrize("make", MAKERS)
def test_of_a_cube_without_a_checksum_the_axes_are_compared(put, asked, make):
    """As versions before have written them."""
    reference = put(make, "c.nc")
    before = reference.copy()
    del before.attrs["values_sha256"]
    before.to_netcdf("c.nc")
    xr.testing.assert_equal(make(out="c.nc"), reference)
    assert not asked
    for change in ("cut", "moved", "reversed", "turned", "less") if make is a_sweep else ("moved", "turned"):
        CHANGES[change](before).to_netcdf("c.nc")
        with pytest.raises(StoreError, match=r"^out = c.nc: exists already, and cannot be used \(c.nc: is a cube"):
            make(out="c.nc")


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1.0, 1e6])
def test_a_point_is_taken_over_bit_for_bit_only(unit):
    old = unit * np.array([0.1, 0.2, 0.3, 0.7])
    assert _places(old, old[[3, 0, 2, 1]]).tolist() == [3, 0, 2, 1]
    for beside in (np.nextafter(old, -np.inf), np.nextafter(old, np.inf), old * (1 - 1e-13), old * (1 + 1e-13)):
        assert _places(old, beside).tolist() == [-1] * 4
    assert _places(old, unit * np.array([0.0, 0.15, 1.0])).tolist() == [-1] * 3


# --- copies that other programs made, or xarray -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "kind"),
    [
        *((make, kind) for make in MAKERS for kind in ("NETCDF4_CLASSIC", "NETCDF3_CLASSIC")),
        (a_sweep, "NETCDF3_64BIT"),
        *(pytest.param(make, "NETCDF3_64BIT", marks=pytest.mark.release) for make in MAKERS[1:]),
    ],
)
def test_a_copy_in_a_classic_format_is_the_same_cube(put, asked, make, kind):
    """These have no whole numbers of 64 bits."""
    reference = put(make, "c.nc")
    with xr.open_dataset("c.nc") as cube:
        cube.load().to_netcdf("copy.nc", format=kind)
    os.replace("copy.nc", "c.nc")
    xr.testing.assert_equal(make(out="c.nc"), reference)
    assert not asked
    assert open_cube("c.nc")["n_events"].dtype == np.int32


def test_whole_numbers_of_a_former_cube_have_64_bits_and_the_same_checksum(fake_kernel):
    cube = sweep()
    wide = cube.copy()
    for name in cube.variables:
        if cube[name].dtype == np.int32:
            wide[name] = cube[name].astype(np.int64)
    wide["made_with"] += 1 << 31  # the bit that they had besides
    assert checksum_of(wide.assign(made_with=cube["made_with"])) == checksum_of(cube) == cube.attrs["values_sha256"]
    point = wide.isel(f=0, beta0=3)
    runs = [dimersweep.simulate(start=each, periods=3) for each in (point, cube.isel(f=0, beta0=3))]
    assert runs[0].parameters == runs[1].parameters


def merged(cube):
    """Parts of a cube as `open_mfdataset` puts them together: with the attributes of the first one."""
    first, second = sweep({"f": [15], "beta0": BETA0}), sweep({"f": [25], "beta0": BETA0})
    return xr.concat([first, second], "f", combine_attrs="override")


@pytest.mark.parametrize(
    ("change", "points"),
    [
        (merged, r"f \(2\) x beta0 \(29\)"),
        (lambda cube: cube.isel(beta0=slice(3)), r"f \(2\) x beta0 \(3\)"),
        (lambda cube: xr.concat([cube, cube.assign_coords(e=0.9)], "e"), r"e \(2\) x f \(2\) x beta0 \(29\)"),
    ],
)
def test_a_declaration_is_not_taken_from_a_cube_of_other_points(change, points):
    change(sweep()).to_netcdf("copy.nc")
    open_cube("copy.nc")  # it can be looked at
    with pytest.raises(
        StoreError, match=rf"^copy.nc: its configuration is that of other points than it has, {points}: "
    ):
        from_cube("copy.nc")


@pytest.mark.parametrize("name", ["e", "r", "mu", "mu_h", "rho_b"])
def test_a_parameter_of_both_ends_that_was_changed_is_told(name):
    cube = sweep().isel(f=0, beta0=3)
    changed = cube.assign_coords({name: 0.9 * cube[name]})
    value = f"{0.9 * cube[name].item():g}"
    for use in (changed.dimersweep.run, lambda: dimersweep.simulate(start=changed)):
        with pytest.raises(
            ParameterError, match=rf"^{name} = {value}: is not that of the run of this point; take the point"
        ):
            use()

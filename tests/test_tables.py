"""Results in one style: words are flags, fixed parameters coordinates, and what is written is read back as it was."""

import subprocess
import sys
from math import prod

import netCDF4
import numpy as np
import pytest
import xarray as xr

import dimersweep
from dimersweep import names, orbits, plots
from dimersweep.analysis.orbits.borders.pictures import draw_borders
from dimersweep.cubes.cube import Column, over_grid, table
from dimersweep.errors import ParameterError, StoreError
from dimersweep.kernel.model.contact_code import contact_state_name
from dimersweep.kernel.model.event_row import E_KIND
from dimersweep.symbols import PARAMETERS, Quantity

pytestmark = pytest.mark.jit
FREE_TEXTS = {"word", "status", "meets", "low_end", "high_end", "low_leads", "high_leads"}
AXIS = {"Gamma": [0.6, 0.9]}
STARTS = {"beta0": ("1 deg", "60 deg")}


MAKERS = {
    "sweep": lambda run: dimersweep.sweep(AXIS, periods=60, certify=True, progress=False),
    "bifurcation": lambda run: dimersweep.bifurcation(AXIS, periods=60, strobes=3, progress=False),
    "search": lambda run: dimersweep.search(
        AXIS | {"beta0": [0.1, 0.25, 0.4]}, over="beta0", ask="first", periods=60, progress=False
    ),
    "loops": lambda run: dimersweep.loops(
        dimersweep.sweep({"e": [0.6], "Gamma": np.linspace(0.7, 1.1, 5)}, periods=200, carry="both", progress=False)
    ),
    "attractors": lambda run: dimersweep.attractors(STARTS, starts=12, periods=300, progress=False),
    "attractors over": lambda run: dimersweep.attractors(
        STARTS, starts=8, over={"Gamma": [0.7, 0.9]}, periods=300, slow=True, confirm=400, progress=False
    ),
    "branch": lambda run: orbits.follow(orbits.find(spin=100.0), "Gamma", to=1.3),
    "branch in the spin": lambda run: orbits.follow(orbits.find(spin=100.0), "spin", to=110.0),
    "family": lambda run: orbits.family(spin=(90.0, 110.0), points=4),
    "fold": lambda run: orbits.border("fold", "Gamma", over={"e": [0.58, 0.6]}, spin=100.0),
    "end": lambda run: orbits.border("stable_to", "Gamma", over={"e": [0.6], "A_r": [6.0, 7.0]}, spin=100.0),
    "change": lambda run: orbits.border("stick_slip", "Gamma", over={"e": [0.6]}, spin=100.0),
    "curve": lambda run: orbits.border_curve("flip", "Gamma", "e", span=(0.59, 0.61), spin=100.0),
    "sustained": lambda run: orbits.sustained(spin=(0, 90), A_r=5, f=22, e=0.65, mu=0.1, mu_s=0.15, Gamma=0.9),
    "events": lambda run: run.events,
    "states": lambda run: run.states([0.0, 1.0]),
    "section": lambda run: run.section(),
    "landings": lambda run: run.section("landing_2"),
    "energy": lambda run: run.energy(),
    "energy of events": lambda run: run.energy("event"),
    "error": lambda run: run.error(),
    "impact": lambda run: plots.impact_rates(run, float(run.section("double_impact")["time"][-1])),
}
ROWS = {  # what the points of a result lie along, where that is not its first variable's
    "fold": ("e",),
    "sustained": ("sustained",),
}


@pytest.fixture(scope="module")
def results():
    """Each kind of result, once."""
    run = dimersweep.simulate(periods=60)
    return {name: make(run) for name, make in MAKERS.items()}


each_result = pytest.mark.parametrize("name", MAKERS)


@each_result
def test_every_result_is_written_as_it_is_and_read_back_equal(name, results, tmp_path):
    results[name].to_netcdf(tmp_path / "result.nc")
    with xr.open_dataset(tmp_path / "result.nc") as back:
        xr.testing.assert_identical(back.load(), results[name])


def contents(path):
    """What a file is made of, as HDF5 has it: dimensions that may grow, types of variables and of attributes."""
    h5py = pytest.importorskip("h5py")
    with netCDF4.Dataset(path) as file:
        growing = [name for name, dim in file.dimensions.items() if dim.isunlimited()]
        variables = {
            name: np.dtype(each.dtype) if each.dtype is not str else str for name, each in file.variables.items()
        }
        names = {"": file.ncattrs()} | {name: each.ncattrs() for name, each in file.variables.items()}
    with h5py.File(path) as file:
        types = {
            (name, each): h5py.h5a.open((file[name] if name else file).id, each.encode()).dtype
            for name in names
            for each in names[name]
        }
        strings = [
            place for place, kind in types.items() if getattr(h5py.check_string_dtype(kind), "length", 1) is None
        ]
    return growing, variables, types, strings


@each_result
@pytest.mark.parametrize("way", ["saved", "to_netcdf"])
def test_a_file_has_what_other_programs_read(name, way, results, tmp_path):
    """No type that classic files lack, no dimension that grows; each file says what it is, and what range its numbers have."""
    path, data = tmp_path / "result.nc", results[name]
    data.dimersweep.save(path) if way == "saved" else data.to_netcdf(path)
    growing, variables, types, strings = contents(path)
    assert strings == [] and growing == ([] if way == "saved" or "meeting" not in data.dims else ["meeting"])
    assert not [each for each in (*variables.values(), *types.values()) if each is str or each in (np.int64, np.uint64)]
    assert {("", each) for each in ("Conventions", "title", "source", "history")} <= types.keys()
    assert not {each for where, each in types if not where} & {"axis", "units", "bounds", "positive", "calendar"}
    assert not [each for each in data.coords if (each, "_FillValue") in types]
    meanings = [each.attrs["long_name"] for each in data.variables.values() if "long_name" in each.attrs]
    assert len(meanings) == len({*meanings})
    if way == "saved":
        with netCDF4.Dataset(path) as file:
            for each, kind in variables.items():
                values = file[each][...]
                values = np.ma.compressed(values)[np.isfinite(np.ma.compressed(values))] if kind.kind in "iuf" else []
                if len(values):
                    ends = file[each].actual_range
                    assert (ends.dtype, *ends) == (kind, values.min(), values.max()), each


@each_result
def test_a_classic_copy_of_a_file_has_the_same_values(name, results, tmp_path):
    results[name].dimersweep.save(tmp_path / "result.nc")
    with xr.open_dataset(tmp_path / "result.nc") as data:
        data.to_netcdf(tmp_path / "classic.nc", format="NETCDF3_CLASSIC")
        with xr.open_dataset(tmp_path / "classic.nc") as copy:
            xr.testing.assert_equal(copy.load(), data.load())
            empty = {each for each, variable in results[name].variables.items() if 0 in variable.shape}
            xr.testing.assert_equal(copy, results[name].drop_vars(empty))


def test_texts_of_a_file_are_signs_in_utf_8(results, tmp_path):
    path = tmp_path / "Γ.nc"
    given = {"title": "Γ über β", "lines": ["µ", "e"], "count": 3, "large": 2**40, "numbers": [1, 2]}
    data = results["branch"].assign_attrs(given)
    data["word"][0] = "µ" * 30
    data["radius"].attrs["comment"] = "Größe"
    data.dimersweep.save(path)
    _, variables, types, strings = contents(path)
    assert strings == [] and variables["word"] == np.dtype("S1")
    assert [types["", each] for each in ("count", "large", "numbers")] == [np.int32, np.int64, np.int32]
    with xr.open_dataset(path) as back:
        assert back["word"].values.tolist() == data["word"].values.tolist()
        assert (back.attrs["title"], back.attrs["lines"], back["radius"].attrs["comment"]) == (
            "Γ über β",
            "µ; e",
            "Größe",
        )
        assert [back.attrs[each] for each in ("count", "large")] == [3, 2**40]
        back.isel(point=slice(1, 3)).dimersweep.save(tmp_path / "part.nc")  # with shorter words
    with pytest.raises(StoreError, match=r"exists already"):
        data.dimersweep.save(path)
    with pytest.raises(ParameterError, match=r"path = result.zarr: a dataset must end in .nc$"):
        data.dimersweep.save("result.zarr")


@each_result
def test_words_of_a_fixed_set_are_flags(name, results):
    data = results[name]
    texts = {str(each) for each in data.variables if data[each].dtype.kind in "OU"}
    assert texts <= FREE_TEXTS | ({"change"} if name == "change" else set())
    for each, variable in data.variables.items():
        assert variable.dtype.kind != "c" and "units" not in variable.attrs.keys() & texts
        if variable.dtype == bool or variable.dtype == np.int8:
            words = names(data[each])
            assert set(words.values.ravel().tolist()) <= set(variable.attrs["flag_meanings"].split())
            assert "units" not in variable.attrs and variable.attrs["long_name"]
    told = names(data)
    assert {
        str(each) for each in told.variables if told[each].dtype.kind == "i" and "flag_values" in told[each].attrs
    } == set()
    assert set(told.coords) == set(data.coords)


@each_result
def test_each_code_of_a_flag_has_one_word_and_each_word_one_code(name, results):
    """As other programs choose by them: cf_xarray takes the one code of a word, NCO the one word of a code."""
    for each, variable in results[name].variables.items():
        if "flag_meanings" in variable.attrs:
            codes, words = variable.attrs["flag_values"], variable.attrs["flag_meanings"].split()
            assert len(codes) == len(words) == len({*words}) == len({*codes.tolist()}), each
            assert codes.dtype == (np.int8 if variable.dtype == bool else variable.dtype)
            told = names(results[name][each]).values
            for code, word in zip(codes, words, strict=True):
                np.testing.assert_array_equal(variable.values == code, told == word, err_msg=f"{each} {word}")


@each_result
def test_fixed_parameters_are_coordinates_with_units(name, results):
    data = results[name]
    assert not [each for each in data.attrs if each in PARAMETERS]
    fixed = {str(each): data[each] for each in data.coords if each in PARAMETERS and not data[each].ndim}
    if "made_with" not in data.variables or "mode" in data:  # of runs, which have their parameters themselves
        known = {"events", "energy", "energy of events", "error", "impact"}
        assert name in known or {"f", "mu", "A_r", "e"} - set(data.variables) == set()
    for each, value in fixed.items():
        assert value.attrs["units"] == PARAMETERS[each].units
        assert value.attrs["long_name"] == PARAMETERS[each].long_name


@each_result
def test_a_table_of_pandas_has_one_row_a_point(name, results):
    data = results[name]
    dims = next(iter(data.data_vars.values())).dims
    table = data.dimersweep.to_dataframe()
    assert len(table) == prod(data.sizes[dim] for dim in dims)
    assert not [
        column for column in table if column in PARAMETERS and column not in data.dims and not data[column].ndim
    ]
    for column in ("multipliers_real", "multipliers_imag"):
        if column in data:
            wide = np.column_stack([table[f"{column}_{k}"] for k in range(data.sizes["multiplier"])])
            np.testing.assert_array_equal(wide, data[column].values.reshape(wide.shape))


def test_one_point_is_one_row(results):
    one = results["bifurcation"].isel(Gamma=1)
    table = one.dimersweep.to_dataframe()
    assert len(table) == 1
    assert table["mode"].tolist() == ["drift"]
    assert table["strobe_gap_2_2"].tolist() == [one["strobe_gap_2"].values[2]]


def test_one_code_chooses_all_rows_that_the_kernel_calls_so():
    run = dimersweep.simulate(periods=60)
    kind, record = run.events["kind"], run.record("events")
    called = np.array([contact_state_name(code) for code in record.events[: kind.size, E_KIND]])
    codes = dict(zip(kind.attrs["flag_meanings"].split(), kind.attrs["flag_values"].tolist(), strict=True))
    assert {"DI_sp_sp", "DI_sp_sk"} < {*called} <= {*codes}
    for word, code in codes.items():
        np.testing.assert_array_equal(kind.values == code, called == word, err_msg=word)


def test_truth_values_choose_points_and_have_words(results):
    branch = results["branch"]
    stable = branch.where(branch["stable"], drop=True)
    assert 0 < stable.sizes["point"] < branch.sizes["point"]
    assert (abs(stable["multipliers_real"].isel(multiplier=0)) <= 1).all()
    assert (names(branch["stable"]) == "yes").equals(branch["stable"].drop_attrs())
    assert names(branch)["stable"].dtype == bool


def test_a_branch_has_its_parameter_as_a_coordinate(results):
    assert results["branch"]["Gamma"].dims == ("point",) and "Gamma" in results["branch"].coords
    assert "spin" in results["branch in the spin"].coords
    assert {"e", "Gamma"} <= set(results["curve"].coords)
    assert set(results["loops"].coords) >= {"e", "f"}


@pytest.mark.parametrize("name", ["attractors", "attractors over", "branch", "fold", "end", "curve", "family", "sweep"])
def test_what_has_a_picture_draws_itself(name, results, tmp_path):
    figure = results[name].dimersweep.plot(path=tmp_path / "drawn.png")
    assert (tmp_path / "drawn.png").stat().st_size > 10_000
    assert figure.axes


def test_a_branch_and_its_border_are_drawn_where_they_are(results):
    branch, curve = results["branch"], results["curve"]
    axes = branch.dimersweep.plot().axes[0]
    (flip,) = np.flatnonzero(names(branch["special"]) == "flip")[:1]
    marked = [line.get_xydata() for line in axes.lines if line.get_marker() not in ("None", None)]
    place = [branch["Gamma"].values[flip], branch["radius"].values[flip]]
    assert min(np.abs(np.array(points) - place).sum(axis=1).min() for points in marked if len(points)) < 1e-12
    axes = curve.dimersweep.plot().axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$e$", r"$\Gamma$")
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), np.column_stack([curve["e"], curve["Gamma"]]))
    assert "axial spin = 100" in results["curve"].dimersweep.plot().get_suptitle()


def test_what_has_none_says_so(results):
    with pytest.raises(ParameterError, match="neither curves nor branches nor families"):
        results["events"].dimersweep.plot()
    with pytest.raises(ParameterError, match="no cube of dimersweep"):
        results["branch"].dimersweep.plot("mode_map")
    with pytest.raises(ParameterError, match="no cube of dimersweep"):
        results["attractors"].dimersweep.drifts()


def formerly(data):
    """A table as former versions had it: words, switches as flags or numbers, and parameters as attributes."""
    words = {name: names(data[name]).astype(object) for name in ("special", "change", "kind") if name in data.variables}
    words = {name: each.where(each != "none", "") for name, each in words.items()}
    switches = {name: each.astype(np.int8) for name, each in data.data_vars.items() if each.dtype == bool}
    fixed = {str(name): float(data[name]) for name in data.coords if name in PARAMETERS and not data[name].ndim}
    return data.assign(words | switches).drop_vars(fixed).assign_attrs(fixed)


@pytest.mark.parametrize("name", ["branch", "fold", "family"])
def test_a_table_of_a_former_version_is_drawn_as_one_of_this_version(name, results):
    before, now = (draw_borders(table) for table in (formerly(results[name]), results[name]))
    assert before.get_suptitle() == now.get_suptitle() != ""
    for one, other in zip(before.axes, now.axes, strict=True):
        assert len(one.lines) == len(other.lines) > 0
        for line, same in zip(one.lines, other.lines, strict=True):
            np.testing.assert_array_equal(line.get_xydata(), same.get_xydata())
            assert (line.get_linestyle(), line.get_marker()) == (same.get_linestyle(), same.get_marker())


@pytest.mark.parametrize(
    ("order", "drawn"), [("import dimersweep, xarray", True), ("import xarray, dimersweep", False)]
)
def test_a_file_opened_in_a_new_process_can_do_what_a_result_can(order, drawn, results, tmp_path):
    results["branch"].to_netcdf(tmp_path / "branch.nc")
    results["sweep"].to_netcdf(tmp_path / "cube.nc")
    program = f"""
import sys, warnings
warnings.simplefilter("error")
{order}
assert "numba" not in sys.modules
print(xarray.open_dataset("cube.nc").dimersweep)
branch = xarray.open_dataset("branch.nc").dimersweep
print(len(branch.plot().axes) if {drawn} else len(branch.to_dataframe()) > 3)
"""
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"<cube of dimersweep over Gamma (2): rest 1, drift 1>\n{3 if drawn else True}\n"


def test_public_names_are_all_that_the_package_and_its_rooms_show():
    assert dir(dimersweep) == sorted([*dimersweep.__all__, "__version__"])
    assert not {"Any", "Path", "ast", "import_module", "faces"} & {*dir(dimersweep)}
    for name in dir(dimersweep):
        assert getattr(dimersweep, name) is not None


def test_orbits_bring_what_their_tables_can_do_without_loading_matplotlib():
    program = """
import sys
from dimersweep.analysis.orbits import family
import xarray
assert hasattr(xarray.Dataset, "dimersweep") and "matplotlib" not in sys.modules
assert xarray.Dataset().dimersweep.is_cube is False and "matplotlib" not in sys.modules
"""
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


ROWS_OF_A_TABLE = [{"n": 1, "way": "up", "at": [0.0, 1.0]}, {"n": 2, "way": "down", "at": [2.0, 3.0]}]


def test_a_table_reads_its_rows_and_takes_columns_as_they_are():
    columns = [
        Column("n", "a number", lambda row: row["n"]),
        Column("way", Quantity("1", "its way"), lambda row: row["way"], ("down", "up")),
        Column("at", Quantity("m", "places"), lambda row: row["at"], along="place"),
        Column("said", "words of it", ["a", "bc"]),
        Column("n", Quantity("s", "the number once more"), [0.5, 1.5]),
    ]
    made = table(ROWS_OF_A_TABLE, columns, "row")
    assert list(made.variables) == ["n", "way", "at", "said"]
    assert made["n"].values.tolist() == [0.5, 1.5] and made["n"].attrs == {
        "units": "s",
        "long_name": "the number once more",
    }
    assert names(made["way"]).values.tolist() == ["up", "down"] and made["way"].dtype == np.int8
    assert made["at"].dims == ("row", "place") and made["said"].values.tolist() == ["a", "bc"]


def test_rows_lie_at_places_of_a_grid_and_other_places_are_empty():
    columns = [
        Column("n", "a number", lambda row: row["n"]),
        Column("at", "places", lambda row: row["at"], along="place"),
    ]
    columns += [
        Column("x", "a length", [0.5, 1.5]),
        Column("said", "words", ["a", "bc"]),
        Column("is", "truth", [True, True]),
    ]
    made = over_grid(table(ROWS_OF_A_TABLE, columns, "row"), [(0, 1), (1, 0)], ("e", "f"), (2, 2))
    assert made["n"].values.tolist() == [[0, 1], [2, 0]] and made["n"].dtype == np.int32
    assert made["at"].dims == ("e", "f", "place") and np.isnan(made["at"].values[0, 0]).all()
    np.testing.assert_array_equal(made["x"].values, [[np.nan, 0.5], [1.5, np.nan]])
    assert made["said"].values.tolist() == [["", "a"], ["bc", ""]]
    assert made["is"].values.tolist() == [[False, True], [True, False]]

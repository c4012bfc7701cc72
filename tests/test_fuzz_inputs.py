"""Whatever people feed in (files cut short, bytes flipped, words misspelt), they get one clear line or what they asked for."""

import contextlib
import csv
import io
import re
import sqlite3
import warnings
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import dimersweep
from dimersweep.cubes.results import Finished, Tile
from dimersweep.errors import ParameterError, StoreError, UserError
from dimersweep.storage.cubefiles import open_cube
from dimersweep.storage.tilestore import tile_store
from dimersweep.studies.declared import Declaration, read_declaration
from dimersweep.studies.point_tables import point_table
from dimersweep.studies.status import status, status_lines
from dimersweep.studies.sweep import study_of
from dimersweep.symbols import INSTEAD, PARAMETERS
from dimersweep.work.tiles import attempt

SWEEPS = Path(__file__).parents[1] / "sweeps"
TEXTS = {path.stem: path.read_text() for path in sorted(SWEEPS.glob("*-small.toml"))}
GRID = {"f": [15, 20], "beta0": {"start": 1, "stop": 10, "step": 1, "unit": "deg"}}
steady = settings(
    derandomize=True,
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
# what a slip of the hand, a unit left in, another program or malice may put where a value stands
TOKENS = st.sampled_from(
    [
        "", "nan", "inf", "-inf", "-1", "0", "1e308", "1e999", "-0.0", "true", "[]", "{}", '""', '"15"', "[[1]]", "[nan]",
        "[1, 1]", "[2, 1]", '{start = 1}', "{start = 0, stop = 1, step = 0}", "{start = 0, stop = 1, step = -1}",
        "{start = 0, stop = 1e9, step = 1e-9}", "{start = 1, stop = 2, num = 3}", "{start = 1, stop = 2, num = 1e3}",
        '{start = 1, stop = 2, step = 1, unit = "Hz"}', "9223372036854775808", "1_000", "0x10", "1979-05-27", "15 Hz",
        '"\\u0000"', "{start = 0.5, stop = 0.7, step = 0.06}", "{start = -1.7e308, stop = 1.7e308, num = 3}", '"16 degrees"',
    ]
)  # fmt: skip


pytestmark = pytest.mark.usefixtures("empty_folder")


def one_line(error):
    """Whether an error is told in a line that says something, or in one for each of the mistakes that it counts."""
    first, *rest = str(error).splitlines()
    counted = re.search(r": (\d+) mistakes$", first)
    return len(first) > 10 and len(rest) == (int(counted[1]) if counted else 0)


def checked(text):
    """What reading a declaration comes to."""
    Path("fuzzed.toml").write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    try:
        assert isinstance(read_declaration("fuzzed.toml"), Declaration)
    except UserError as error:
        assert one_line(error), error
        assert str(error).startswith("fuzzed.toml: ")


# --- declarations -------------------------------------------------------------------------------------------------------


@steady
@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_a_value_of_a_declaration_replaced(name, data):
    lines = TEXTS[name].splitlines()
    places = [k for k, line in enumerate(lines) if "=" in line and not line.lstrip().startswith("#")]
    place = data.draw(st.sampled_from(places))
    key = lines[place].split("=")[0]
    lines[place] = f"{key}= {data.draw(TOKENS)}"
    checked("\n".join(lines))


@steady
@given(st.sampled_from(sorted(TEXTS)), st.data())
def test_a_line_of_a_declaration_lost_doubled_or_moved(name, data):
    lines = TEXTS[name].splitlines()
    take, put = data.draw(st.integers(0, len(lines) - 1)), data.draw(st.integers(0, len(lines) - 1))
    line = lines[take] if data.draw(st.booleans()) else lines.pop(take)
    if data.draw(st.booleans()):
        lines.insert(put, line)
    checked("\n".join(lines))


@steady
@given(st.sampled_from(sorted(TEXTS)), st.integers(0), st.binary(max_size=4), st.booleans())
def test_bytes_of_a_declaration_changed(name, place, bytes_, cut):
    written = TEXTS[name].encode()
    place %= len(written)
    checked(written[:place] + bytes_ + (b"" if cut else written[place + len(bytes_) :]))


NAMES = st.lists(st.sampled_from(["f", "Gamma", "e", "e_1", "phi0"]), min_size=1, max_size=3, unique=True)
CELLS = st.sampled_from(["0.5", "1", "0.9", " 1", '"1"']) | st.sampled_from(
    ["f", "1e999", "nan", "NA", "", " ", '"', "16 deg", "\x00", ";", '"\n']
)


@settings(steady, max_examples=200)
@given(NAMES, st.data())
def test_a_table_of_anything_has_the_values_of_its_lines_or_is_refused(names, data):
    cells = st.lists(data.draw(st.sampled_from([CELLS, st.just("1")])), min_size=len(names), max_size=len(names))
    lines = data.draw(
        st.lists(cells | st.lists(CELLS, max_size=4), max_size=3) | st.lists(cells, min_size=1, max_size=3)
    )
    rows, end = [",".join(line) for line in (names, *lines)], data.draw(st.sampled_from(["\n", "\r\n", "\n\n", "\r"]))
    Path("fuzzed.csv").write_bytes(end.join(rows).encode())
    try:
        table = point_table(file="fuzzed.csv", columns={}, ranges={}, sample=None, number=None, seed=None)
        columns = study_of(None, points=table, periods=1).grid.columns
    except UserError as error:
        assert one_line(error), error
        return
    read = csv.reader(io.StringIO(end.join(rows[1:]), newline=""), skipinitialspace=True)  # a cell may span lines
    kept = [row for row in read if "".join(row)]
    assert list(columns) == names
    assert [values.size for values in columns.values()] == [len(kept)] * len(names)


# --- numbers of other libraries -----------------------------------------------------------------------------------------


class Quantity:
    """A number or an array with a unit, as pint's and astropy's are: numpy takes its numbers and forgets the unit."""

    def __init__(self, numbers, **unit):
        self.numbers = np.asarray(numbers)
        self.ndim, self.shape, self.dtype = self.numbers.ndim, self.numbers.shape, self.numbers.dtype
        vars(self).update(unit)

    def __array__(self, dtype=None, copy=None):
        return self.numbers.astype(dtype)

    def item(self):
        return self.numbers.item()

    def __repr__(self):
        return "5 K"


def in_kelvin(values, **more):
    return xr.DataArray(values, attrs={"units": "K"}, **more)


OTHER_KIND = "r = .*: has the unit K; the unit must be m, mm or the like$"
IN_SECONDS = "r = .*: (has the unit s; )?the unit must be m, mm or the like$"
DATE = "r = .*: must be a number; of dates give the time since one of them$"
NONE = "r = .*: must be a number$"
SINGLE = {
    "masked": (np.ma.masked, "r = masked: has masked values; give numbers only$"),
    "masked, of no dimension": (np.ma.array(5e-3, mask=True), "r = .*: has masked values; give numbers only$"),
    "pint": (Quantity(5.0, units="K"), OTHER_KIND),
    "pint, a unit that is no text": (Quantity(5.0, units=Path("K")), OTHER_KIND),
    "astropy": (Quantity(5.0, unit="K"), OTHER_KIND),
    "xarray": (in_kelvin(5.0), OTHER_KIND),
    "a date": (np.datetime64(5, "ns"), DATE),
    "a duration": (np.timedelta64(5, "s"), IN_SECONDS),
    "a bool": (np.True_, NONE),
    "bytes": (b"5", NONE),
    "complex": (np.complex128(5), NONE),
    "no value": (pd.NA, NONE),
}
SEVERAL = {
    "masked": (np.ma.array([5e-3, 6e-3], mask=[0, 1]), "r = .*: has masked values; give numbers only$"),
    "masked in a list": ([5e-3, np.ma.masked], "r = masked: has masked values; give numbers only$"),
    "pint": (Quantity([5.0, 6.0], units="K"), OTHER_KIND),
    "pint in a list": ([Quantity(5.0, units="K"), 6.0], OTHER_KIND),
    "xarray": (in_kelvin([5.0, 6.0], dims="x"), OTHER_KIND),
    "xarray's variable": (in_kelvin([5.0, 6.0], dims="x").variable, OTHER_KIND),
    "dates": (np.array([1, 2], "M8[ns]"), DATE),
    "durations": (np.array([1, 2], "m8[s]"), IN_SECONDS),
    "bools": (np.array([False, True]), NONE),
    "complex": (np.array([1 + 0j]), NONE),
    "objects": (np.array([5e-3, None], dtype=object), "r = None: must be a number$"),
    "no values": (pd.array([5e-3, None], dtype="Float64"), "r = .*: has masked values; give numbers only$"),
    "ragged": ([[5e-3], [5e-3, 6e-3]], NONE),
    "too long a float": (np.array(["1e4000"], dtype=np.longdouble), "r = inf: must be finite$"),
}


@pytest.mark.parametrize(("value", "message"), SINGLE.values(), ids=SINGLE)
def test_what_is_no_plain_number_is_refused_wherever_it_stands(value, message):
    places = {
        "": lambda: dimersweep.simulate(r=value, periods=1),
        "fixed": lambda: study_of({"f": [15]}, {"r": value}, periods=1),
        "fixed, value": lambda: study_of({"f": [15]}, {"r": {"value": value, "unit": "m"}}, periods=1),
        "start": lambda: study_of({"r": {"start": value, "stop": 1.0, "num": 2}}, periods=1),
        "found": lambda: dimersweep.orbits.find(r=value),
        "border": lambda: dimersweep.orbits.border("fold", "Gamma", over={"r": [value]}),
    }
    for place, call in places.items():
        with pytest.raises(ParameterError, match=message.replace("r = ", r"r(\.start)? = ")) as caught:
            call()
        assert one_line(caught.value), place
    with pytest.raises(ParameterError, match=message.replace("r = ", "^start.gap_1 = ")):
        dimersweep.simulate(start={"gap_1": value}, periods=1)
    with pytest.raises(ParameterError, match=r"^periods = "):
        dimersweep.simulate(periods=value)


@pytest.mark.parametrize(("values", "message"), SEVERAL.values(), ids=SEVERAL)
def test_what_are_no_plain_numbers_is_refused_wherever_it_stands(values, message):
    places = {
        "axis": lambda: study_of({"r": values}, periods=1),
        "values": lambda: study_of({"r": {"values": values, "unit": "m"}}, periods=1),
        "points": lambda: study_of(None, points={"r": values}, periods=1),
        "over": lambda: dimersweep.orbits.border("fold", "Gamma", over={"r": values}),
    }
    for place, call in places.items():
        with pytest.raises(ParameterError, match="^" + message) as caught:
            call()
        assert one_line(caught.value), place


def test_numbers_that_carry_the_unit_of_their_parameter_are_taken():
    made = study_of({"f": xr.DataArray([15.0, 20.0], attrs={"units": "Hz"}), "mu": np.ma.array([0.1])}, periods=1)
    assert made.grid.axes["f"].tolist() == [15, 20] and made.grid.axes["mu"].tolist() == [0.1]
    assert dimersweep.simulate(r=xr.DataArray(4e-3, attrs={"units": "m"}), periods=1).parameters["r"] == 4e-3
    points = xr.Dataset({"r": ("point", [5.0, 6.0], {"units": "mm"})})
    assert study_of(None, {"D_r": 1e-3}, points=points, periods=1).grid.columns["r"].tolist() == [5e-3, 6e-3]


def test_ends_of_a_range_that_are_too_far_apart_and_columns_of_one_name_are_refused():
    ends = {"start": -1.7e308, "stop": 1.7e308}
    for many in ({"num": 3}, {"step": 1e307}):
        with pytest.raises(ParameterError, match=r"^xdot0.stop = 1.7e\+308: is too far from start = -1.7e\+308$"):
            study_of({"xdot0": ends | many}, periods=1)
    with pytest.raises(ParameterError, match=r"^points.ranges.f: stop = 1e\+300 is too far from start = 1e-300$"):
        drawn = {"f": {"start": 1e-300, "stop": 1e300, "spacing": "log"}}
        point_table(file=None, columns={}, ranges=drawn, sample=None, number=2, seed=None)
    with pytest.raises(ParameterError, match=r"^points: has 2 columns f; give each parameter once$"):
        study_of(None, points=pd.DataFrame([[15.0, 16.0]], columns=["f", "f"]), periods=1)


# --- cubes --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def cube(fake_kernel):
    """A small cube in a file, and its bytes."""
    made = dimersweep.sweep(GRID, periods=5, out="cube.nc", progress=False)
    return made, Path("cube.nc").read_bytes()


def opened(written, expected):
    """Open a cube of these bytes: an error in one line, or the cube that was written."""
    Path("fuzzed.nc").write_bytes(written)
    try:
        found = open_cube("fuzzed.nc")
    except StoreError as error:
        assert one_line(error), error
        return
    xr.testing.assert_identical(found, expected)


@steady
@given(st.data())
def test_a_cube_cut_short(cube, data):
    made, written = cube
    opened(written[: data.draw(st.integers(0, len(written) - 1))], made)


@steady
@given(st.data())
def test_a_cube_with_bytes_flipped(cube, data):
    made, written = cube
    changed = bytearray(written)
    for place in data.draw(st.lists(st.integers(0, len(written) - 1), min_size=1, max_size=3)):
        changed[place] ^= 1 << data.draw(st.integers(0, 7))
    opened(bytes(changed), made)


@pytest.mark.parametrize("name", ["radius", "mode", "beta0", "e"])
def test_a_number_of_a_cube_changed(cube, name):
    """A disk that forgets a bit of a result: nothing but a checksum can tell."""
    with h5py.File("cube.nc") as file:
        stored = file[name].id
        if stored.shape:
            chunk = stored.get_chunk_info(0)
            place, size = chunk.byte_offset, chunk.size
        else:
            place, size = stored.get_offset(), stored.get_storage_size()
    changed = bytearray(cube[1])
    changed[place + size // 2] ^= 1
    Path("fuzzed.nc").write_bytes(changed)
    with pytest.raises(StoreError, match=r"damaged|changed") as caught:
        open_cube("fuzzed.nc")
    assert one_line(caught.value)


@steady
@given(st.binary(max_size=200), st.sampled_from([b"", b"CDF\x01", b"\x89HDF\r\n\x1a\n", b"PK\x03\x04", b"%PDF-1.7"]))
def test_a_foreign_file_for_a_cube(bytes_, magic):
    Path("fuzzed.nc").write_bytes(magic + bytes_)
    with pytest.raises(StoreError) as caught:
        open_cube("fuzzed.nc")
    assert one_line(caught.value)


def test_a_foreign_dataset_for_a_cube():
    xr.Dataset({"mode": ("x", np.arange(3))}).to_netcdf("fuzzed.nc")
    with pytest.raises(StoreError, match="no cube of dimersweep"):
        open_cube("fuzzed.nc")


# --- what a killed sweep leaves behind ----------------------------------------------------------------------------------


@pytest.fixture
def left_behind(fake_kernel):
    """What a sweep has left that was killed halfway, and the whole cube."""
    expected = dimersweep.sweep(GRID, periods=5, progress=False)
    spec = study_of(GRID, periods=5)
    with tile_store(Path("cube.nc"), spec.configuration(), spec.grid.size) as store:
        for tile in ((0, 6), (8, 12)):
            store.add(Finished(Tile(*tile), attempt(spec, np.arange(*tile)).results))
            store.flush()
    return Path("cube.nc.tiles").read_bytes(), expected


@steady
@given(st.data())
def test_damage_to_what_was_finished_is_never_used(left_behind, data):
    written, expected = left_behind
    Path("cube.nc").unlink(missing_ok=True)
    changed = bytearray(written)
    place = data.draw(st.integers(0, len(changed) - 1))
    how = data.draw(st.sampled_from(["flip", "cut", "insert"]))
    if how == "flip":
        changed[place] ^= 1 << data.draw(st.integers(0, 7))
    elif how == "cut":
        del changed[place:]
    else:
        changed[place:place] = data.draw(st.binary(min_size=1, max_size=8))
    Path("cube.nc.tiles").write_bytes(bytes(changed))
    try:
        with warnings.catch_warnings(action="ignore"):
            found = dimersweep.sweep(GRID, periods=5, progress=False, out="cube.nc")
    except UserError as error:
        assert one_line(error), error
        return
    xr.testing.assert_equal(found, expected)


ANYTHING = st.none() | st.integers(-(2**63), 2**63 - 1) | st.floats() | st.text(max_size=5) | st.binary(max_size=5)


@steady
@given(ANYTHING, st.sampled_from(["configuration", "points", "wanted", "scratch", "layout", "configuration_sha256"]))
def test_a_store_that_tells_anything(left_behind, value, name):
    """A sound file of SQLite with another meaning than that of a store."""
    Path("cube.nc.tiles").write_bytes(left_behind[0])
    with contextlib.closing(sqlite3.connect("cube.nc.tiles")) as file, file:
        file.execute("UPDATE about SET value = ? WHERE name = ?", (value, name))
    try:
        assert status_lines(status(Path("cube.nc")))[0].startswith("cube.nc: 10 of ")
    except UserError as error:
        assert one_line(error), error


# --- the command line ---------------------------------------------------------------------------------------------------

VALUES = st.sampled_from(
    ["", "nan", "inf", "-inf", "1e999", "abc", "0x10", "1,5", "--Gamma", "\x00", "é", "[1]", "None", "2 3", "2**3"]
)
WORDS = st.sampled_from(
    ["simulate", "run", "plan", "status", "plot", "--periods", "--rtol", "--out", "--from", "--plot", "--workers",
     "nofile.toml", ".", "/", "/dev/null", "fuzzed.toml", "--force", "--retry", "-x", "--", "rtol", "out.txt", "--extend",
     "--scheduler", "x"]
)  # fmt: skip


@steady
@given(st.sampled_from([*PARAMETERS, *INSTEAD, "periods", "rtol"]), VALUES)
def test_a_wrong_value_of_a_parameter_is_told(call, name, value):
    _, err, code = call("simulate", f"--{name}", value)
    assert code == 2, (name, value, err)
    assert err.startswith("dimersweep: error: ")
    assert len(err.splitlines()) == 1
    assert name in err or value in err


@steady
@given(st.lists(WORDS, min_size=1, max_size=5))
def test_a_command_line_of_words(call, words):
    """Nothing here names a sweep that exists, so that nothing can be done."""
    assume(words != ["simulate"] and not {"status", "plot"} >= set(words))
    _, err, code = call(*words)
    if code:
        assert code == 2, err
        assert err.startswith("dimersweep: error: "), err
        assert len(err.splitlines()) == 1, err

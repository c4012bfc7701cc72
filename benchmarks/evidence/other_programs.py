"""Our files in other programs: ``python benchmarks/evidence/other_programs.py``.

Writes one file of each kind, has every program that is installed read it, compares each number and each text with what
netCDF4 reads, and prints the table of the page on other programs. ``--keep FOLDER`` leaves the files there; ``--only NAME``
tries the programs whose names begin so.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.checks.kinds_of_files import KINDS, write

Values = dict[
    str, Any
]  # of the variables of a file by their names: arrays of numbers in their order on disk, or of texts
SECONDS = 120  # for one program and one file


class Refused(Exception):
    """A program that does not read a file, with what it says."""


def told(*command: object, **how: Any) -> bytes:
    """What a command prints; `Refused` where it fails."""
    done = subprocess.run(list(map(str, command)), check=False, capture_output=True, timeout=SECONDS, **how)
    if done.returncode:
        said = (done.stderr + done.stdout).decode("utf-8", "replace")
        lines = [line.strip() for line in said.splitlines() if line.strip()]
        ended = f"ends by signal {-done.returncode}" if done.returncode < 0 else f"ends with {done.returncode}"
        raise Refused(
            next((line for line in lines if re.search(r"error|fail|not |unknown", line, re.IGNORECASE)), ended)
        )
    return done.stdout


# --- what is in a file ----------------------------------------------------------------------------------------------


def texts(values: Any) -> np.ndarray:
    """Texts, or bytes in UTF-8, without what pads them."""
    plain = [each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each) for each in np.ravel(values)]
    return np.array([each.rstrip("\0 ") for each in plain], dtype=str)


def read_netcdf(path: Path) -> Values:
    """All variables of a file, as the netCDF library of Python has them: the reference."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        return {name: plain(variable[...]) for name, variable in file.variables.items()}


def plain(values: Any) -> np.ndarray:
    """Values in the order on disk: numbers, texts, or the texts of an array of characters."""
    values = np.asarray(values)
    if values.dtype.kind == "S" and values.dtype.itemsize == 1 and values.ndim:
        values = np.array([row.tobytes() for row in values.reshape(-1, values.shape[-1])], dtype=object)
    return texts(values) if values.dtype.kind in "SUO" else values.ravel()


def kind_of(name: str, values: np.ndarray, axes: Collection[str]) -> str:
    """What a variable is: an axis, a text, a single number or an array."""
    if name in axes:
        return "axes"
    return "texts" if values.dtype.kind == "U" else "single numbers" if values.size == 1 else "arrays"


def compared(want: Values, got: Values, axes: Collection[str]) -> str:
    """How the values that a program gives compare with those wanted, NaN equal to NaN: "=", or what is absent or differs."""
    absent = sorted({kind_of(name, values, axes) for name, values in want.items() if name not in got})
    differ = [name for name in want if name in got and not same(want[name], got[name])]
    words = ([f"without {', '.join(absent)}"] if absent else []) + (
        [f"other values of {', '.join(differ[:3])}{' and more' if len(differ) > 3 else ''}"] if differ else []
    )
    return ", ".join(words) or "="


def same(want: np.ndarray, got: Any) -> bool:
    """Whether the values are equal, whatever the type of the numbers."""
    got = plain(got)
    if want.shape != got.shape:
        return False
    if "U" in (want.dtype.kind, got.dtype.kind):
        return want.dtype.kind == got.dtype.kind and bool(np.all(want == got))
    return np.array_equal(want.astype(float), got.astype(float), equal_nan=True)


def opened(path: Path, **how: Any) -> Any:
    """A file in xarray, its masks and times undecoded."""
    import xarray as xr

    with xr.open_dataset(path, decode_times=False, mask_and_scale=False, **how) as data:
        return data.load()


def numbers(path: Path, least: int = 0) -> dict[str, tuple[int, ...]]:
    """Shapes of the variables that hold numbers along so many dimensions, or more."""
    variables = opened(path, engine="netcdf4").variables.items()
    return {
        str(name): each.shape
        for name, each in variables
        if each.ndim >= least and each.dtype.kind in "iufb" and each.size
    }


def grids(path: Path) -> dict[str, tuple[int, ...]]:
    """Shapes of the variables that hold numbers along two dimensions or more."""
    return numbers(path, 2)


def lines(path: Path) -> dict[str, tuple[int, ...]]:
    """Shapes of the variables that hold numbers along one dimension or more."""
    return numbers(path, 1)


# --- programs -------------------------------------------------------------------------------------------------------

Reader = Callable[[Path, Path], Values | None]  # of a file, with a folder to write in; none: it shows no numbers


class Program(NamedTuple):
    """One row of the table."""

    name: str
    version: Callable[[], str]
    read: Reader
    suffix: str
    asked: Callable[[Path], Iterable[str]] | None  # variables that it can hold; all, if it is not given


PROGRAMS: list[Program] = []


def installed(*command: str, line: str) -> Callable[[], str]:
    """The version that a command tells in a line that matches; none where there is no such command."""

    def ask() -> str:
        if not shutil.which(command[0]):
            return ""
        done = subprocess.run(command, check=False, capture_output=True, text=True, errors="replace")
        found = re.search(line, done.stdout + done.stderr)
        return found.group(1) if found else ""

    return ask


def package(name: str) -> Callable[[], str]:
    """The version of a package of Python; none where it is not installed."""

    def ask() -> str:
        try:
            return version(name)
        except PackageNotFoundError:
            return ""

    return ask


def program(
    name: str, version: Callable[[], str], suffix: str = ".nc", asked: Callable[[Path], Iterable[str]] | None = None
) -> Callable[[Reader], Reader]:
    """Enter a reader into the table."""

    def enter(read: Reader) -> Reader:
        PROGRAMS.append(Program(name, version, read, suffix, asked))
        return read

    return enter


NETCDF_BIN = installed("ncdump", line=r"library version (\S+)")
NCO = installed("ncks", "--version", line=r"ncks version (\S+)")
CDO = installed("cdo", "--version", line=r"version (\S+)")
GDAL = installed("gdalinfo", "--version", line=r"GDAL ([\d.]+)")
GMT = installed("gmt", "--version", line=r"(\S+)")
OCTAVE = installed("octave-cli", "--version", line=r"version (\S+)")


def in_r(name: str) -> Callable[[], str]:
    """The version of a package of R."""
    return installed(
        "Rscript", "-e", f"cat('version', as.character(packageVersion('{name}')))", line=r"version ([\d.]+)"
    )


@program("ncdump, ncgen", NETCDF_BIN)
def _(path: Path, scratch: Path) -> Values:
    (scratch / "a.cdl").write_bytes(told("ncdump", "-p", "9,17", path))
    told("ncgen", "-4", "-o", scratch / "a.nc", scratch / "a.cdl")
    return read_netcdf(scratch / "a.nc")


def copied(name: str, version: Callable[[], str], *command: str) -> None:
    """Enter a program that copies a file: what the copy has is what it made of it."""

    @program(name, version)
    def _(path: Path, scratch: Path) -> Values:
        told(*command, path, scratch / "a.nc")
        return read_netcdf(scratch / "a.nc")


copied("nccopy -k classic", NETCDF_BIN, "nccopy", "-k", "classic")
copied("NCO: ncks", NCO, "ncks", "-O")
copied("NCO: ncks -3", NCO, "ncks", "-O", "-3")
copied("CDO", CDO, "cdo", "-s", "-O", "-f", "nc4", "copy")


@program("GDAL: gdalmdiminfo", GDAL)
def _(path: Path, scratch: Path) -> Values:
    arrays = json.loads(told("gdalmdiminfo", "-detailed", path))["arrays"]

    def numbers(values: Any) -> Any:
        return [numbers(each) for each in values] if isinstance(values, list) else values

    return {
        name: np.array(numbers(array["values"]), dtype=object if array["datatype"] == "String" else float)
        for name, array in arrays.items()
        if "values" in array
    }


@program("GDAL: gdal_translate", GDAL, asked=grids)
def _(path: Path, scratch: Path) -> Values:
    found = {}
    turned = ("--config", "GDAL_NETCDF_BOTTOMUP", "NO")  # rows as in the file
    for name in grids(path):
        source = f'NETCDF:"{path}":{name}'
        told("gdal_translate", *turned, "-q", "-ot", "Float64", "-of", "ENVI", source, scratch / "a.img")
        found[name] = np.fromfile(scratch / "a.img")
    return found


@program("GMT", GMT, asked=lines)
def _(path: Path, scratch: Path) -> Values:
    """Grids come in single precision: they are compared with what is next to that."""
    found: Values = {}
    want = read_netcdf(path)
    for name, shape in lines(path).items():
        if len(shape) == 1:
            found[name] = np.frombuffer(told("gmt", "convert", f"{path}?{name}", "-bo1d", cwd=scratch))
            continue
        layers = []
        for place in np.ndindex(*shape[:-2]):
            layer = f"[{','.join(map(str, place))}]" if place else ""
            printed = np.frombuffer(told("gmt", "grd2xyz", f"{path}?{name}{layer}", "-bo3d", cwd=scratch))
            if printed.size == 3 * np.prod(shape[-2:]):  # it says "Unknown grid format", ends with 0 and prints nothing
                layers.append(printed.reshape(*shape[-2:], 3)[::-1, :, 2])
        single = np.array(layers).ravel()
        if single.size == want[name].size:
            close = np.array_equal(single.astype(np.float32), want[name].astype(np.float32), equal_nan=True)
            found[name] = want[name] if close else single
    return found


OCTAVE_READS = """
pkg load netcdf
info = ncinfo(path);
names = fopen("names.txt", "w"); out = fopen("values.bin", "w");
for k = 1:numel(info.Variables)
  name = info.Variables(k).Name;
  try
    v = ncread(path, name);
  catch
    fprintf(names, "%s failed 0 1\\n", name); continue
  end
  if ischar(v)
    fprintf(names, "%s text %d %d\\n", name, numel(v), size(v, 1)); fwrite(out, v(:), "double");
  else
    fprintf(names, "%s numbers %d 1\\n", name, numel(v)); fwrite(out, double(v(:)), "double");
  end
end
fclose(names); fclose(out);
"""
R_READS = {
    "ncdf4": """
library(ncdf4); nc <- nc_open(path)
all <- c(names(nc$var), names(nc$dim)[sapply(nc$dim, function(d) d$create_dimvar)])
get <- function(name) ncvar_get(nc, name, raw_datavals = TRUE)
""",
    "RNetCDF": """
library(RNetCDF); nc <- open.nc(path)
all <- sapply(seq_len(file.inq.nc(nc)$nvars) - 1, function(k) var.inq.nc(nc, k)$name)
get <- function(name) var.get.nc(nc, name, na.mode = 3)
""",
}
R_WRITES = """
names <- file("names.txt", "w"); out <- file("values.bin", "wb")
for (name in all) {
  v <- tryCatch(get(name), error = function(e) NULL)
  if (is.null(v)) cat(name, "failed", 0, 1, "\\n", file = names)
  else if (is.character(v)) for (each in v) cat(name, "\\t", each, "\\n", sep = "", file = names)
  else { cat(name, "numbers", length(v), 1, "\\n", file = names); writeBin(as.double(v), out) }
}
close(names); close(out)
"""


def from_script(command: list[str], script: str, path: Path, scratch: Path) -> Values:
    """Run a script that writes what it has read: names and kinds in one file, numbers in another."""
    (scratch / "script").write_text(script)
    told(*command, scratch / "script", cwd=scratch)
    values, found, at = np.fromfile(scratch / "values.bin"), {}, 0
    lines: dict[str, list[str]] = {}
    for line in (scratch / "names.txt").read_text(encoding="utf-8", errors="replace").splitlines():
        if "\t" in line:
            name, text = line.split("\t", 1)
            lines.setdefault(name, []).append(text)
            continue
        name, kind, size, length = line.split()
        part = values[at : at + int(size)]
        at += int(size)
        if kind == "numbers":
            found[name] = part
        elif kind == "text":
            rows = part.astype(np.uint8).reshape(-1, int(length))
            found[name] = np.array([row.tobytes() for row in rows], dtype=object)
    return found | {name: texts(rows) for name, rows in lines.items()}


@program("Octave", OCTAVE)
def _(path: Path, scratch: Path) -> Values:
    return from_script(["octave-cli", "--norc", "-q"], f'path = "{path}";\n' + OCTAVE_READS, path, scratch)


for _name, _script in R_READS.items():

    @program(f"R: {_name}", in_r(_name))
    def _(path: Path, scratch: Path, script: str = _script) -> Values:
        return from_script(["Rscript", "--vanilla"], f'path <- "{path}"\n' + script + R_WRITES, path, scratch)


@program("R: stars", in_r("stars"), asked=grids)
def _(path: Path, scratch: Path) -> Values:
    names = ", ".join(f'"{name}"' for name in grids(path))
    reads = f"""
Sys.setenv(GDAL_NETCDF_BOTTOMUP = "NO"); suppressMessages(library(stars)); all <- c({names})
get <- function(name) suppressWarnings(as.vector(read_stars("{path}", sub = name)[[1]]))
"""
    return from_script(["Rscript", "--vanilla"], reads + R_WRITES, path, scratch) if names else {}


@program("HDF5: h5dump", installed("h5dump", "--version", line=r"Version (\S+)"), asked=numbers)
def _(path: Path, scratch: Path) -> Values:
    found = {}
    want = read_netcdf(path)
    for name in numbers(path):
        told("h5dump", "-d", f"/{name}", "-b", "LE", "-o", scratch / "a.bin", path)
        found[name] = np.fromfile(scratch / "a.bin", want[name].dtype)
    return found


@program("h5py", package("h5py"))
def _(path: Path, scratch: Path) -> Values:
    import h5py

    with h5py.File(path) as file:
        return {name: np.asarray(each[()]) for name, each in file.items()}


@program("PyTables", package("tables"), asked=numbers)
def _(path: Path, scratch: Path) -> Values:
    import tables

    found = {}
    with tables.open_file(path) as file:
        for name in numbers(path):
            with suppress(
                KeyError
            ):  # an axis is absent: its references to variables are of a kind that it does not know
                found[name] = np.asarray(file.get_node(f"/{name}").read())
    return found


@program("xarray", package("xarray"))
def _(path: Path, scratch: Path) -> Values:
    return {name: each.values for name, each in opened(path, engine="netcdf4").variables.items()}


@program("xarray by h5netcdf", package("h5netcdf"))
def _(path: Path, scratch: Path) -> Values:
    return {name: each.values for name, each in opened(path, engine="h5netcdf").variables.items()}


@program("iris", package("scitools-iris"))
def _(path: Path, scratch: Path) -> Values:
    import iris

    found: Values = {}
    for cube in iris.load(path):
        found[cube.var_name] = unmasked(cube.data)
        found |= {each.var_name: unmasked(each.points) for each in cube.coords() if each.var_name not in found}
    return found


def unmasked(values: Any) -> Any:
    """Values with NaN in the place of those that are masked."""
    return np.ma.filled(values.astype(float), np.nan) if np.ma.is_masked(values) else np.asarray(values)


@program("cf_xarray, flags", package("cf_xarray"))
def _(path: Path, scratch: Path) -> Values:
    import cf_xarray  # noqa: F401

    found: Values = {}
    data = opened(path)
    for name in data.variables:
        attrs = data[name].attrs
        found[str(name)] = data[name].values
        if "flag_meanings" in attrs:  # the codes again, from the words
            found[str(name)] = np.full(data[name].shape, -1)
            for code, word in zip(np.ravel(attrs["flag_values"]), attrs["flag_meanings"].split(), strict=True):
                found[str(name)][(data[name].cf == word).values] = code
    return found


@program("pint-xarray", package("pint-xarray"))
def _(path: Path, scratch: Path) -> Values:
    import pint_xarray  # noqa: F401
    from cf_xarray.units import units

    data = opened(path).pint.quantify(unit_registry=units)
    return {name: data[name].pint.dequantify().values for name in data.variables}


def columns(path: Path) -> list[str]:
    """The variables of a table: those that have the dimensions of the first one."""
    data = opened(path)
    dims = next(iter(data.data_vars.values())).dims
    return [str(name) for name, each in data.data_vars.items() if each.dims == dims]


def as_frame(path: Path) -> Any:
    """A file as a table of pandas, with its index as columns."""
    return opened(path)[columns(path)].reset_coords(drop=True).to_dataframe().reset_index()


@program("polars", package("polars"), asked=columns)
def _(path: Path, scratch: Path) -> Values:
    import polars

    frame = polars.from_pandas(as_frame(path))
    return {name: frame[name].to_numpy() for name in frame.columns}


@program("duckdb", package("duckdb"), asked=columns)
def _(path: Path, scratch: Path) -> Values:
    import duckdb

    return {name: unmasked(each) for name, each in duckdb.from_df(as_frame(path)).fetchnumpy().items()}


@program("pyarrow", package("pyarrow"), asked=columns)
def _(path: Path, scratch: Path) -> Values:
    import pyarrow

    table = pyarrow.Table.from_pandas(as_frame(path), preserve_index=False)
    return {name: table[name].to_numpy() for name in table.column_names}


VTK_READS = """
import sys, numpy as np
from vtkmodules.vtkIONetCDF import vtkNetCDFCFReader
from vtkmodules.util.numpy_support import vtk_to_numpy
reader = vtkNetCDFCFReader(); reader.SetFileName(sys.argv[1]); reader.SphericalCoordinatesOff(); reader.UpdateMetaData()
names = reader.GetAllVariableArrayNames(); found = {}
for k in range(names.GetNumberOfValues()):
    name = names.GetValue(k)
    for j in range(names.GetNumberOfValues()):
        reader.SetVariableArrayStatus(names.GetValue(j), j == k)
    reader.Update(); data = reader.GetOutput()
    for part in (data.GetPointData(), data.GetCellData()):
        array = part.GetArray(name)
        if array is not None:
            found[name] = vtk_to_numpy(array)
np.savez(sys.argv[2], **found)
"""


@program("VTK: CF reader", package("vtk"), asked=numbers)
def _(path: Path, scratch: Path) -> Values:
    told(sys.executable, "-c", VTK_READS, path, scratch / "a.npz")
    return dict(np.load(scratch / "a.npz"))


@program("ncview", installed("ncview", line=r"Ncview (\S+)"))
def _(path: Path, scratch: Path) -> None:
    """It gives no numbers out: whether its window stays open, and says nothing of an error."""
    done = subprocess.run(
        ["xvfb-run", "-a", "timeout", "3", "ncview", str(path)],
        check=False,
        capture_output=True,
        text=True,
        cwd=scratch,
        timeout=SECONDS,
    )
    lines = (done.stdout + done.stderr).splitlines()
    said = [line for line in lines if re.search("^(?!Note).*(error|can't|unknown|no displayable)", line)]
    if done.returncode != 124 or said:
        raise Refused(said[0] if said else f"ends with {done.returncode}")


# --- Zarr -----------------------------------------------------------------------------------------------------------


def read_zarr(path: Path) -> Values:
    """All arrays of a group, as the package zarr has them: the reference."""
    import zarr

    return {name: plain(array[...]) for name, array in zarr.open_group(path, mode="r").arrays()}


@program("zarr", package("zarr"), ".zarr")
def _(path: Path, scratch: Path) -> Values:
    return read_zarr(path)


@program("xarray", package("xarray"), ".zarr")
def _(path: Path, scratch: Path) -> Values:
    return {name: each.values for name, each in opened(path, engine="zarr", consolidated=False).variables.items()}


@program("tensorstore", package("tensorstore"), ".zarr")
def _(path: Path, scratch: Path) -> Values:
    import tensorstore

    return {
        each.parent.name: tensorstore.open(
            {"driver": "zarr3", "kvstore": {"driver": "file", "path": f"{each.parent}/"}}, open=True
        )
        .result()
        .read()
        .result()
        for each in path.glob("*/zarr.json")
    }


@program("netCDF4", package("netCDF4"), ".zarr")
def _(path: Path, scratch: Path) -> Values:
    return read_netcdf(Path(f"file://{path}#mode=zarr,file"))


@program("ncdump", NETCDF_BIN, ".zarr")
def _(path: Path, scratch: Path) -> Values:
    (scratch / "a.cdl").write_bytes(told("ncdump", "-p", "9,17", f"file://{path}#mode=zarr,file"))
    told("ncgen", "-4", "-o", scratch / "a.nc", scratch / "a.cdl")
    return read_netcdf(scratch / "a.nc")


@program("GDAL: gdalmdiminfo", GDAL, ".zarr")
def _(path: Path, scratch: Path) -> Values:
    arrays = json.loads(told("gdalmdiminfo", "-detailed", path)).get("arrays", {})
    return {name: np.array(each["values"], dtype=float) for name, each in arrays.items() if "values" in each}


# --- the table ------------------------------------------------------------------------------------------------------


def attempt(each: Program, path: Path) -> str:
    """Have a program read a file; what came of it in a few words."""
    want = read_netcdf(path) if path.suffix == ".nc" else read_zarr(path)
    if each.asked:
        want = {name: want[name] for name in each.asked(path)}
    if not want:
        return "holds no such arrays"
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            got = each.read(path, Path(folder))
        except Exception as error:  # whatever a program of others may raise: its row says so
            kind = "" if isinstance(error, Refused) else f"{type(error).__name__}: "
            said = f"{kind}{' '.join(str(error).split())}".replace(str(path.parent) + os.sep, "").replace("|", "/")
            return f"refused ({said[:90].strip()})"
        return "opens" if got is None else compared(want, got, opened(path).sizes)


def row_of(each: Program, paths: dict[str, Path]) -> str:
    """The line of the table of one program: how it read which kinds."""
    outcomes: dict[str, list[str]] = {}
    for kind, path in paths.items():
        outcomes.setdefault(attempt(each, path), []).append(kind)
    *rest, (most, kinds) = sorted(outcomes.items(), key=lambda each: len(each[1]))
    everything = "all others" if rest else "all" if len(kinds) > 1 else kinds[0]
    cells = [f"{words}: {', '.join(kinds)}" for words, kinds in rest] + [f"{most}: {everything}"]
    return f"| {each.name} | {each.version()} | {'. '.join(cells)} |"


def main() -> None:
    """Write the files, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="folder for the files, which stay there")
    parser.add_argument("--only", default="", help="programs whose names begin so")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.keep or Path(scratch)).resolve()
        paths = {kind: write(kind, folder) for kind in KINDS}
        print("| program | version | what it made of each kind of file |\n|---|---|---|")
        for each in PROGRAMS:
            if each.name.lower().startswith(given.only.lower()) and each.version():
                own = {kind: path for kind, path in paths.items() if path.suffix == each.suffix}
                print(row_of(each, own), flush=True)
        missing = sorted({each.name for each in PROGRAMS if not each.version()})
        print(f"not installed here: {', '.join(missing) or 'none'}")


if __name__ == "__main__":
    main()

"""The commands for measurements: a record of the plate's accelerations, and a track of the dimer."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dimersweep.cli.drawing import check_files, keep
from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import (
    OUTPUT,
    Drawn,
    Force,
    Spin,
    argument,
    in_lines,
    number_option,
    option,
    parted,
)
from dimersweep.errors import ParameterError, unknown
from dimersweep.symbols import PARAMETERS

if TYPE_CHECKING:
    import xarray as xr

# separators of columns, with those of decimals; a comma may be either, so it comes last as a separator of columns
SEPARATORS = ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (r"\s+", "."), (r"\s+", ","), (",", "."))
BRACKETS = r"[\[(](.*)[\])]"  # brackets around a unit
SOUGHT = 500  # lines within which the first numbers must stand: a longer head is no head
Column = Annotated[str | None, option("Its column, where it is not found by its name.", metavar="NAME")]


def waveform(
    context: typer.Context,
    record: Annotated[Path, argument("RECORD.csv", "Columns of times and accelerations.")],
    *,
    t: Column = None,
    z: Column = None,
    x: Column = None,
    y: Column = None,
    f: Annotated[float | None, number_option("Frequency (Hz); it is found by default.")] = None,
    g: Annotated[float, number_option("Gravity in the record's unit.")] = 9.81,
    out: Annotated[Path | None, option("File of the plate's motion (TOML), for --harmonics.", group=OUTPUT)] = None,
    plot: Drawn = None,
    force: Force = False,
) -> None:
    """Print the harmonics of a plate from a record of its accelerations, and write them to a file for --harmonics."""
    tell, _ = context.obj
    check_files(out, plot, force=force, what="a waveform", endings=(".toml",))
    with interruptible(out, plot):
        from dimersweep.analysis.fits import Waveform

        table = table_of(record)
        axes = named(record, table, {"t": t, "z": z, "x": x, "y": y}, "z")
        found = Waveform.fit(axes.pop("t"), table, f, axes=axes, g=g)
        tell(f"f: {found.f:.9g} Hz, error {found.errors['f']:.2g} Hz", f=found.f, f_error=found.errors["f"])
        rows = [
            (axis, k, *(each for pair in zip(wave[k], found.errors[axis][k], strict=True) for each in pair))
            for axis, wave in found.waves.items()
            for k in wave
        ]
        units = {"axis": "", "harmonic": "", "intensity": "1", "its error": "1", "phase": "rad", "error": "rad"}
        tell.rows("harmonics", units, rows)
        rest = [f"not periodic along {axis}: {size:.3g} g" for axis, size in found.rest.items()]
        others = [f"another line at {each:.6g} Hz: {max(sizes.values()):.3g} g" for each, sizes in found.others.items()]
        tell(*rest, *others, *found.notes, rest=found.rest, others=found.others, notes=found.notes)
        keep(tell, found, out, plot, force=force, noun="plate")


def fitted() -> list[str]:
    """Return the beginnings of all ranges that can be fitted, for completion by a shell."""
    return [f"{name}=" for name in (*PARAMETERS, "spin")]


def fit(
    context: typer.Context,
    track: Annotated[Path, argument("TRACK.csv", "Columns of times and places of the centre of mass.")],
    free: Annotated[list[str], argument("NAME=LOW:HIGH...", "Ranges to fit, such as e=0.5:0.7.", fitted)],
    *,
    t: Column = None,
    x: Column = None,
    y: Column = None,
    sigma: Annotated[str | None, option("Error of a coordinate (m, or 2mm).", metavar="NUMBER")] = None,
    moving: Annotated[bool, option("Let the centre of the circle move evenly.", "--moving")] = False,
    spin: Spin = None,
    out: Annotated[Path | None, option("File of what is printed (.txt).", group=OUTPUT)] = None,
    plot: Drawn = None,
    force: Force = False,
) -> None:
    """Print which parameters give a track, with their errors, and what it leaves open."""
    tell, parameters = context.obj
    check_files(out, plot, force=force, what="a text", endings=(".txt",))
    ranges: Any = dict(parted(each, 2, also=("spin",)) for each in free)
    with interruptible(out, plot):
        tell.report_compiling()
        from dimersweep.analysis.fits import circle, cycloid
        from dimersweep.analysis.fits.fitting import fit, unit_of
        from dimersweep.storage.files import replacing

        table = table_of(track)
        columns = named(track, table, {"t": t, "x": x, "y": y}, "xy")
        seen = table[[*columns.values()]].dropna("sample")  # frames in which the camera found no dimer are empty
        drawn = cycloid if moving else circle
        path = drawn(seen[columns["t"]], seen[columns["x"]], seen[columns["y"]], sigma)
        tell(in_lines(str(path)[1:-1]), track=path.values, track_errors=path.errors, sigma=path.sigma)
        found = fit(path, ranges, spin=spin, progress=not tell.quiet, **parameters)
        units = dict.fromkeys(("parameter", "value", "error", "low", "high", "unit"), "")
        rows = [
            (name, found.values[name], found.errors[name], *ends, unit_of(name)) for name, ends in found.ranges.items()
        ]
        tell.rows("fitted", units, rows)
        chance = f"chi-square {found.chi_square:.3g}; a greater one has a probability of {found.probability:.2g}"
        notes = (*found.notes, *found.undetermined)
        tell(*map(in_lines, (chance, *notes)), possible=found.possible, chi_square=found.chi_square, notes=notes)
        if out is not None:
            with replacing(out) as temporary:
                temporary.write_text(f"{found.table()}\n", encoding="utf-8")
            tell(f"text: {out}", text=str(out))
        keep(tell, found, None, plot, force=force)


def named(path: Path, table: "xr.Dataset", given: dict[str, str | None], wanted: str) -> dict[str, str]:
    """Return the columns of t and of axes: given by the user, or with names such as t, z, az, a_z or acc_z.

    If none of the wanted axes has such a name, they are the columns that are left, if their number fits. Raise a
    ParameterError if a column is missing, or several have such names.
    """
    from dimersweep.inputs import is_unit

    names, known = [str(name) for name in table], dict[str, str]()
    for axis, name in given.items():
        pattern = r"t(ime.*)?" if axis == "t" else rf"((a|acc|p|pos)\w*?)?[\W_]*{axis}(axis)?(\.\d+)?"
        found = [each for each in names if re.fullmatch(pattern, each, re.I)] if name is None else [name]
        if axis == "t" and not found:
            found = [each for each in names if is_unit(table[each].attrs.get("units", ""), like="s")]
        if len(found) > 1:
            raise ParameterError(f"{path}: has {len(found)} columns {axis}, {', '.join(found)}; give --{axis}")
        if {*found} - {*names}:
            raise ParameterError(f"{path}: {unknown(found[0], 'column', names)}")
        if found:
            known[axis] = found[0]
    missing = [axis for axis in ("t", *wanted) if axis not in known]
    left = [name for name in names if name not in known.values()]
    # without a head the first column has the times; with a head it may be another one, such as numbers of frames
    as_they_stand = "t" not in missing or names[0] == "1"
    if as_they_stand and {*missing} >= {*wanted} and len(left) == len(missing):
        return known | dict(zip(missing, left, strict=True))
    if missing:
        raise ParameterError(f"{path}: has no column {missing[0]}; give --{missing[0]} (there are {', '.join(names)})")
    return known


def table_of(path: Path) -> "xr.Dataset":
    """Return the columns of a file of numbers, with the units in its head.

    Loggers separate columns and decimals in several ways, which are tried one after the other.

    Raises
    ------
    ParameterError
        If the file has no columns of numbers.
    """
    import pandas as pd
    import xarray as xr

    from dimersweep.inputs import is_unit, read_text

    lines = read_text(path).splitlines()[:SOUGHT]
    for separator, decimal in SEPARATORS:
        number = re.compile(rf"[-+]?\d*[{decimal}]?\d+[{decimal}]?([eE][-+]?\d+)?")
        rows = [[each.strip(' "') for each in re.split(separator, line.strip().lstrip("#"))] for line in lines]
        wide = [len(row) if len(row) > 1 and all(map(number.fullmatch, row)) else 0 for row in rows]
        first = next((k for k in range(len(rows) - 1) if wide[k] and wide[k] == wide[k + 1]), None)
        if first is not None:
            break
    else:
        raise ParameterError(f"{path}: has no columns of numbers")
    heads = [row for row in rows[:first] if len(row) == wide[first]][-2:]
    # a line of units may stand below that of names
    if len(heads) == 2 and all(not each or re.fullmatch(BRACKETS, each) or is_unit(each) for each in heads[1]):
        heads = [[f"{name} [{unit.strip('[]()')}]" for name, unit in zip(*heads, strict=True)]]
    names = heads[-1] if heads else [str(k + 1) for k in range(wide[first])]
    how = {"sep": separator, "decimal": decimal, "skiprows": first, "header": None, "comment": "#"}
    frame = pd.read_csv(path, **how, encoding="utf-8-sig")
    columns: dict[str, Any] = {}
    for k, head in enumerate(names):
        found = re.fullmatch(rf"(.*?)\s*(?:{BRACKETS}|[/_]\s*(\D\S*))", head)
        has_unit = found is not None and (found[2] is not None or is_unit(found[3]))
        name, unit = (found[1], found[2] or found[3]) if found and has_unit else (head, "")
        name = f"{name}.{k + 1}" if name in columns else name
        columns[name] = ("sample", frame[k].to_numpy(), {"units": unit} if unit else {})
    return xr.Dataset(columns)

"""The command for a record of the plate's accelerations."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, Force, argument, number_option, option
from dimersweep.cli.printing import Printer, telling
from dimersweep.errors import ParameterError

if TYPE_CHECKING:
    import xarray as xr

# of columns and of decimals; a comma is one of both, so it comes last
SEPARATORS = ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (r"\s+", "."), (r"\s+", ","), (",", "."))
UNIT = r"[\[(]?(s|ms|us|µs|g|mg|m/s2|m/s\^2|m/s²|m s-2)[\])]?"
SOUGHT = 500  # lines in which the first numbers stand
Column = Annotated[str | None, option("Its column, where it is not found by its name.", metavar="NAME")]


@telling
def waveform(
    tell: Printer,
    record: Annotated[Path, argument("RECORD.csv", "Columns of times and accelerations.")],
    *,
    t: Column = None,
    z: Column = None,
    x: Column = None,
    y: Column = None,
    f: Annotated[float | None, number_option("Frequency (Hz); it is found by default.")] = None,
    g: Annotated[float, number_option("Gravity in the record's unit.")] = 9.81,
    out: Annotated[Path | None, option("File of the plate's motion (TOML), for --harmonics.", group=OUTPUT)] = None,
    plot: Annotated[Path | None, option("Picture of it.", group=OUTPUT)] = None,
    force: Force = False,
) -> None:
    """Print the harmonics of a plate from a record of its accelerations, and write them to a file for --harmonics."""
    from dimersweep.fits import Waveform
    from dimersweep.plots.style import check_picture, write_picture
    from dimersweep.storage.outputs import check_output

    if out is not None:
        check_output(out, force=force, what="a waveform", endings=(".toml",))
    if plot is not None:
        check_picture(plot, force=force, name="plot")
    with interruptible(out, plot):
        table = _table(record)
        times = t or next((name for name in table if re.match(r"t(\W|_|$|ime)", str(name), re.I)), next(iter(table)))
        others = [str(name) for name in table if name != times]
        axes = {axis: given or _along(axis, others) for axis, given in (("z", z), ("x", x), ("y", y))}
        axes["z"] = axes["z"] or (others[0] if len(others) == 1 else None)
        if axes["z"] is None:
            raise ParameterError(f"{record}: has no column z; give --z (there are {', '.join(others)})")
        found = Waveform.fit(str(times), table, f, axes={k: name for k, name in axes.items() if name}, g=g)
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
        if out is not None:
            found.save(out, force=force)
            tell(f"plate: {out}", out=str(out))
        if plot is not None:
            write_picture(found.plot(), plot, force=force)
            tell(f"picture: {plot}", picture=str(plot))


def _along(axis: str, names: list[str]) -> str | None:
    """Return the column that is named after an axis, such as z, az, a_z or acc_z, if there is one."""
    return next((name for name in names if re.fullmatch(rf"(a|acc\w*?)?[\W_]*{axis}(axis)?", name, re.I)), None)


def _table(path: Path) -> "xr.Dataset":
    """Return the columns of a file of numbers, however a logger separates them, with the units in its head.

    Raises
    ------
    ParameterError
        If it has no columns of numbers.
    """
    import pandas as pd
    import xarray as xr

    from dimersweep.inputs import read_text

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
    if len(heads) == 2 and all(re.fullmatch(UNIT, each) for each in heads[1]):  # a line of units below that of names
        heads = [[f"{name} [{unit.strip('[]()')}]" for name, unit in zip(*heads, strict=True)]]
    names = heads[-1] if heads else [str(k + 1) for k in range(wide[first])]
    how = {"sep": separator, "decimal": decimal, "skiprows": first, "header": None, "comment": "#"}
    frame = pd.read_csv(path, **how, encoding="utf-8-sig")
    columns = {}
    for k, name in enumerate(names):
        found = re.fullmatch(r"(.*?)\s*[\[(](.*)[\])]", name)
        attributes = {"units": found[2]} if found else {}
        columns[found[1] if found else name] = ("sample", frame[k].to_numpy(), attributes)
    return xr.Dataset(columns)

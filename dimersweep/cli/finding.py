"""The commands for the orbits of one dimer, and for the motions that many starts come to."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, Force, Workers, argument, number_option, option, with_parameters
from dimersweep.cli.printing import Printer, telling
from dimersweep.errors import ParameterError
from dimersweep.symbols import PARAMETERS, units_shown

if TYPE_CHECKING:
    import xarray as xr

OF_CIRCLES = ("kind", "spin", "radius", "period", "zeta", "speed", "attracts", "slow_time")
OF_ORBITS = ("spin", "radius", "period", "zeta", "speed", "stable", "word")
OF_POINTS = ("special", "change", "spin", "radius", "period", "stable")
OF_ATTRACTORS = ("attractor", "mode", "share", "share_low", "share_high", "periods", "stable", "radius", "spin")
OF_FATES = ("fate", "spin_low", "spin_high")
HEADS = {"word": "sequence"}  # of columns that have other names in files

Table = Annotated[Path | None, option("File to keep the result in (NetCDF).", group=OUTPUT)]
Drawn = Annotated[Path | None, option("Picture of it.", group=OUTPUT)]


@telling
@with_parameters
def orbits(
    tell: Printer,
    *,
    spin: Annotated[
        str | None,
        option("Axial spin (rad/s, or 1000rpm) of the orbit to find; else the circles that last.", metavar="NUMBER"),
    ] = None,
    follow: Annotated[
        str | None, option("Follow that orbit in a parameter to a value, such as Gamma=1.3.", metavar="NAME=VALUE")
    ] = None,
    out: Table = None,
    plot: Drawn = None,
    force: Force = False,
    **parameters: Any,
) -> None:
    """Print the circles that a dimer can walk for good, or the orbit of a spin, or what becomes of it over a parameter."""
    if spin is None and (follow is not None or plot is not None):
        raise ParameterError("--follow and --plot need --spin, that of the orbit")
    if spin is not None and follow is None and out is not None:
        raise ParameterError("--out needs --follow, or no --spin: one orbit is no table")
    _check_files(out, plot, force=force)
    given = {each: value for each, value in parameters.items() if value is not None}
    with interruptible(out, plot):
        tell.report_compiling()
        from dimersweep import orbits as found
        from dimersweep.orbits.orbit import dataset

        if spin is None:
            circles = found.sustained(**given)
            _print(tell, "circles", circles, OF_CIRCLES)
            return _keep(tell, circles, out, None, force=force)
        orbit = found.find(spin=spin, **given)
        _print(tell, "orbits", dataset((orbit, *orbit.others), "orbit"), OF_ORBITS)
        if follow is None:
            return _keep(tell, orbit, None, plot, force=force)
        name, _, to = follow.partition("=")
        branch = found.follow(orbit, name, to=to)
        special = branch.isel(point=branch["special"].values != 0)
        _print(tell, "special_points", special, (name, *OF_POINTS))
        tell(f"end of the branch: {branch.attrs['end']}", end=branch.attrs["end"])
        return _keep(tell, branch, out, plot, force=force)


@telling
@with_parameters
def attractors(
    tell: Printer,
    ranges: Annotated[list[str], argument("NAME=LOW:HIGH...", "Ranges of a start, such as beta0=1deg:89deg.")],
    *,
    starts: Annotated[int, number_option("Starts that are drawn.", int)] = 1000,
    seed: Annotated[int, number_option("Of the draw.", int)] = 0,
    over: Annotated[
        str | None, option("A parameter over which they are followed.", metavar="NAME=START:STOP:STEP")
    ] = None,
    slow: Annotated[bool, option("Tell starts apart by where their spin comes to in the end.", "--slow")] = False,
    periods: Annotated[int, number_option("Forcing periods of each run at most.", int)] = 1000,
    rtol: Annotated[float, number_option("Accuracy, 1e-13 to 1e-2.")] = 1e-8,
    workers: Workers = None,
    out: Table = None,
    plot: Drawn = None,
    force: Force = False,
    **parameters: Any,
) -> None:
    """Print which motions there are, and the share of drawn starts that comes to each."""
    _check_files(out, plot, force=force)
    fixed = {each: value for each, value in parameters.items() if value is not None}
    drawn = dict(_parted(each, 2) for each in ranges)
    name, values = _parted(over, 3) if over else ("", [])
    with interruptible(out, plot):
        tell.report_compiling()
        from dimersweep.studies.attractors import attractors

        found = attractors(
            drawn,
            fixed,
            starts=starts,
            seed=seed,
            over={name: dict(zip(("start", "stop", "step"), values, strict=True))} if over else None,
            slow=slow,
            periods=periods,
            rtol=rtol,
            workers=workers,
            progress=not tell.quiet,
        )
        heads = (*([name] if over else ()), *OF_ATTRACTORS, *(OF_FATES if slow else ()))
        _print(tell, "attractors", found, heads)
        _keep(tell, found, out, plot, force=force)


def _check_files(out: Path | None, plot: Path | None, *, force: bool) -> None:
    """Refuse files that could not be written."""
    from dimersweep.plots import check_picture
    from dimersweep.storage.outputs import TABLES, check_output

    if out is not None:
        check_output(out, force=force, what="a table", endings=TABLES)
    if plot is not None:
        check_picture(plot, force=force, name="plot")


def _parted(text: str, count: int) -> tuple[str, list[Any]]:
    """The name and the values in a text such as Gamma=0.8:1:0.05."""
    name, _, values = text.partition("=")
    parts = values.split(":")
    if name not in PARAMETERS or len(parts) != count:
        ways = {2: "NAME=LOW:HIGH, such as beta0=1deg:89deg", 3: "NAME=START:STOP:STEP, such as Gamma=0.8:1:0.05"}
        raise ParameterError(f"{text!r}: must be {ways[count]}")
    return name, parts


def _print(tell: Printer, name: str, table: "xr.Dataset", columns: tuple[str, ...]) -> None:
    """Print columns of a table, with words in place of flags."""
    from dimersweep.cubes.cube import names

    frame = names(table[[*columns]]).to_dataframe().reset_index()[[*columns]]
    if "mode" in columns:
        frame = frame[frame["mode"] != "not_run"]  # over a parameter: an attractor that is not there
    units = {HEADS.get(each, each): units_shown(table[each].attrs.get("units", "1")) for each in columns}
    tell.rows(name, units, frame.itertuples(index=False, name=None))


def _keep(tell: Printer, made: Any, out: Path | None, plot: Path | None, *, force: bool) -> None:
    """Write a table, and the picture of that or of an orbit, where they were asked for."""
    if out is not None:
        from dimersweep.storage.cubefiles import write_cube

        write_cube(made, out, force=force)
        tell(f"table: {out}", table=str(out))
    if plot is not None:
        getattr(made, "dimersweep", made).plot(path=plot, force=force)
        tell(f"picture: {plot}", picture=str(plot))

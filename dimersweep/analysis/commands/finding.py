"""The commands for the orbits of one dimer, its motion after a long time, and the attractors of many starts."""

from math import nan
from typing import TYPE_CHECKING, Annotated

import typer

from dimersweep.cli.drawing import check_files, keep
from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import (
    Accuracy,
    Drawn,
    Force,
    Spin,
    Table,
    Workers,
    argument,
    number_option,
    option,
    parted,
)
from dimersweep.cli.printing import Printer
from dimersweep.errors import ParameterError
from dimersweep.symbols import QUANTITIES, units_shown

if TYPE_CHECKING:
    import xarray as xr

OF_CIRCLES = ("kind", "spin", "radius", "period", "zeta", "speed", "attracts", "slow_time")
OF_ORBITS = ("spin", "radius", "period", "zeta", "speed", "stable", "word")
OF_POINTS = ("special", "change", "spin", "radius", "period", "stable")
OF_ATTRACTORS = ("attractor", "mode", "share", "share_low", "share_high", "periods", "stable", "radius", "spin")
OF_FATES = ("fate", "spin_low", "spin_high")
HEADS = {"word": "sequence"}  # heads of columns that have other names in files
OF_LATER = ("spin", "radius", "period", "zeta")
SETTLED_WITHIN = 2000  # longest run in which a start settles on its orbit, in forcing periods


def orbits(
    context: typer.Context,
    *,
    spin: Spin = None,
    follow: Annotated[
        str | None, option("Follow that orbit in a parameter to a value, such as Gamma=1.3.", metavar="NAME=VALUE")
    ] = None,
    out: Table = None,
    plot: Drawn = None,
    force: Force = False,
) -> None:
    """Print the circles that a dimer can walk for good, or the orbit of a spin, or its branch over a parameter."""
    tell, parameters = context.obj
    if spin is None and (follow is not None or plot is not None):
        raise ParameterError("--follow and --plot need --spin, that of the orbit")
    if spin is not None and follow is None and out is not None:
        raise ParameterError("--out needs --follow, or no --spin: one orbit is no table")
    check_files(out, plot, force=force)
    with interruptible(out, plot):
        tell.report_compiling()
        from dimersweep.analysis import orbits as found
        from dimersweep.analysis.orbits.map.orbit import dataset

        if spin is None:
            circles = found.sustained(**parameters)
            _print(tell, "circles", circles, OF_CIRCLES)
            return keep(tell, circles, out, None, force=force)
        orbit = found.find(spin=spin, **parameters)
        _print(tell, "orbits", dataset((orbit, *orbit.others), "orbit"), OF_ORBITS)
        if follow is None:
            return keep(tell, orbit, None, plot, force=force)
        name, _, to = follow.partition("=")
        branch = found.follow(orbit, name, to=to)
        special = branch.isel(point=branch["special"].values != 0)
        _print(tell, "special_points", special, (name, *OF_POINTS))
        tell(f"end of the branch: {branch.attrs['end']}", end=branch.attrs["end"])
        return keep(tell, branch, out, plot, force=force)


def later(
    context: typer.Context,
    *,
    spin: Spin = None,
    seconds: Annotated[str | None, option("Time (s, or 3h), or inf.", metavar="NUMBER")] = None,
    periods: Annotated[float | None, number_option("Time in forcing periods, in place of seconds.")] = None,
) -> None:
    """Print on which circle a dimer walks after some hours, or in the end."""
    tell, parameters = context.obj
    if (seconds is None) == (periods is None):
        raise ParameterError("give either --seconds, such as 3h, or --periods")
    tell.report_compiling()
    from dimersweep.analysis import orbits as found
    from dimersweep.runs.simulating import simulate

    start = None if spin is not None else simulate(periods=SETTLED_WITHIN, stop_when_settled=True, **parameters)
    if start is not None and not start.mode_period:
        raise ParameterError(f"the start leads to {start.mode}, which is on no orbit; give another one, or --spin")
    orbit = found.find(start, spin=spin, **parameters)
    then = found.later(orbit, periods=periods, seconds=seconds)
    rows = [("at first", *(getattr(orbit, name) for name in OF_LATER), "")]
    for leap in then.leaps:
        rows.append((f"leap after {leap.after:.6g} periods", leap.spin[1], leap.radius[1], nan, nan, ""))
    time = f"{periods:g} periods" if seconds is None else seconds if seconds[-1:].isalpha() else f"{seconds} s"
    rows.append((f"after {time}", *(getattr(then, name) for name in OF_LATER), then.mode))
    units = {name: units_shown(QUANTITIES[name].units) for name in OF_LATER}
    tell.rows("later", {"when": "", **units, "mode": ""}, rows)


def attractors(
    context: typer.Context,
    ranges: Annotated[list[str], argument("NAME=LOW:HIGH...", "Ranges of a start, such as beta0=1deg:89deg phi0=any.")],
    *,
    starts: Annotated[int, number_option("Starts that are drawn.", int)] = 1000,
    seed: Annotated[int, number_option("Of the draw.", int)] = 0,
    over: Annotated[
        str | None, option("A parameter over which they are followed.", metavar="NAME=START:STOP:STEP")
    ] = None,
    slow: Annotated[bool, option("Tell starts apart by where their spin comes to in the end.", "--slow")] = False,
    periods: Annotated[int, number_option("Forcing periods of each run at most.", int)] = 1000,
    rtol: Accuracy = 1e-8,
    workers: Workers = None,
    out: Table = None,
    plot: Drawn = None,
    force: Force = False,
) -> None:
    """Print which motions there are, and the share of drawn starts that comes to each."""
    tell, parameters = context.obj
    check_files(out, plot, force=force)
    drawn = dict(parted(each, 2) for each in ranges)
    name, values = parted(over, 3) if over else ("", [])
    with interruptible(out, plot):
        tell.report_compiling()
        from dimersweep.analysis.attractors.shares import attractors

        found = attractors(
            drawn,
            parameters,
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
        keep(tell, found, out, plot, force=force)


def _print(tell: Printer, name: str, table: "xr.Dataset", columns: tuple[str, ...]) -> None:
    """Print columns of a table, with words in place of flags."""
    from dimersweep.cubes.cube import names

    frame = names(table[[*columns]]).to_dataframe().reset_index()[[*columns]]
    if "mode" in columns:
        frame = frame[frame["mode"] != "not_run"]  # an attractor that does not exist at this value
    units = {HEADS.get(each, each): units_shown(table[each].attrs.get("units", "1")) for each in columns}
    tell.rows(name, units, frame.itertuples(index=False, name=None))

"""The command for a single run."""

from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, Accuracy, Force, in_lines, number_option, option
from dimersweep.cli.printing import print_table
from dimersweep.kernel.model.layout import DOWN_WORDS, RUN_COLUMNS
from dimersweep.runs.outcomes import MissingValue
from dimersweep.symbols import ORBIT_NAMES, QUANTITIES, stated

if TYPE_CHECKING:
    from dimersweep.runs.run import Run


def simulate(
    context: typer.Context,
    *,
    periods: Annotated[int, number_option("Forcing periods to run.", int)] = 100,
    rtol: Accuracy = 1e-8,
    stop_when_settled: Annotated[
        bool, option("End as soon as the motion has settled and its numbers stand.", "--stop-when-settled")
    ] = False,
    plot: Annotated[Path | None, option("Picture of heights, orbit and phase portraits.", group=OUTPUT)] = None,
    movie: Annotated[
        Path | None, option("Movie of the last periods: .gif, .mp4 or .html (in 3D).", group=OUTPUT)
    ] = None,
    save: Annotated[Path | None, option("File to keep the run in (NetCDF), for load_run.", group=OUTPUT)] = None,
    error: Annotated[bool, option("Print bounds on the errors too, from two more runs.", "--error")] = False,
    max_seconds: Annotated[
        str | None, option("Bound on the time of the run (s, or 5min); none by default.", metavar="NUMBER")
    ] = None,
    force: Force = False,
) -> None:
    """Run one dimer and print its mode and its orbit."""
    tell, parameters = context.obj
    if plot is not None:
        from dimersweep.plots import check_picture

        check_picture(plot, force=force, name="plot")
    if movie is not None:
        from dimersweep.plots.movie import check_movie

        check_movie(movie, force=force)
    if save is not None:
        from dimersweep.storage.outputs import TABLES, check_output

        check_output(save, force=force, name="save", what="a run", endings=TABLES)
    from dimersweep.inputs import check_count, check_rtol, check_seconds
    from dimersweep.parameters import Parameters

    # checked here as well, so that a typing error is reported before seconds of imports and compiling
    Parameters(**parameters)
    check_count("periods", periods)
    check_rtol(rtol)
    check_seconds(max_seconds)
    recorded = error or bool(plot or movie or save)
    with interruptible(save, plot, movie):
        tell.report_compiling()
        from dimersweep.cubes.seen_run import meanings
        from dimersweep.runs.simulating import simulate
        from dimersweep.runs.solving import check_recorded

        if recorded:
            check_recorded(periods, "--plot, --movie, --save and --error")
        how: dict[str, Any] = {"stop_when_settled": stop_when_settled, "record": recorded, "max_seconds": max_seconds}
        run = simulate(**parameters, periods=periods, rtol=rtol, **how)
        bounds = _bounds(run) if error else {}
        tell(in_lines(run.conditions()), **_as_dict(run), **bounds)
        if tell.shown:
            _print_table(run, bounds)
        if run.status != "ok":
            tell(in_lines(f"{run.status}: {run.message}"))
        tell(*(in_lines(f"{word}: {meaning}") for word, meaning in meanings(run).items()))
        if save is not None:  # before the movie, which may take long and be interrupted
            run.save(save, force=force)
            tell(f"run: {save}", save=str(save))
        if plot is not None:
            run.plot(plot, force=force)
            tell(f"picture: {plot}", plot=str(plot))
        if movie is not None:
            run.animate(movie, force=force)
            tell(f"movie: {movie}", movie=str(movie))


def _as_dict(run: "Run") -> dict[str, Any]:
    """Return the outcome of `run`, as JSON can hold it."""
    names = ("status", "message", "mode", "mode_period", "track", "n_events", "n_periods", "end_speed", *RUN_COLUMNS)
    return {
        "parameters": stated(run.parameters),
        **{name: getattr(run, name) for name in names},
        "orbit": None if isinstance(run.orbit, MissingValue) else asdict(run.orbit),
    }


def _bounds(run: "Run") -> dict[str, float]:
    """Return bounds on the errors at the end of `run`: of its state, in its scales [1], and of its event times [s].

    Where a slip passes zero in a double impact and `rtol` decides, the time of that impact [s] is among them.
    """
    errors = run.error()
    found = {"state_error": float(errors["scaled"][-1]), "event_time_error": float(errors["event_time"].max())}
    undecided = float(errors["slip_undecided"])
    return found if isnan(undecided) else found | {"slip_undecided": undecided}


def _print_table(run: "Run", bounds: dict[str, float]) -> None:
    """Print the outcome of `run` as a table, with the bounds on its errors."""
    rows: list[tuple[str, ...]] = [("status", run.status), ("mode", run.mode)]
    if run.mode_period > 1:
        rows.append(("repeats every", str(run.mode_period), "periods"))
    if run.mode in DOWN_WORDS:
        rows.append(("both ends stay down, speed", f"{run.end_speed:.4g}", "m/s"))
    if run.track != "none":
        rows.append(("track", run.track))
    if not isnan(run.centre_velocity_x):
        velocity = f"{run.centre_velocity_x:.4g}, {run.centre_velocity_y:.4g}"
        rows.append(("velocity of the centre", velocity, "m/s"))
    rows += [("forcing periods", str(run.n_periods)), ("events", str(run.n_events))]
    for name, bound in bounds.items():
        if name == "slip_undecided":
            rows.append(("rtol decides a slip at", f"{bound:.6g}", "s"))
        else:
            rows.append((name.replace("_", " "), f"below {bound:.1e}", "s" if "time" in name else "1"))
    if run.orbit:
        for name in ORBIT_NAMES:
            value, drift = getattr(run.orbit, name), getattr(run.orbit, f"{name}_drift")
            cells = (f"{value:.8g}", QUANTITIES[name].units, f"{drift:.2e}")
            rows.append((name, *(("none: straight",) if isnan(value) else cells)))
        for name in ("path_radius", "path_speed"):
            value = getattr(run.orbit, name)
            rows.append((name, "none: straight" if isnan(value) else f"{value:.8g}", QUANTITIES[name].units))
        rows.append(("double impact ends", run.orbit.di_end))
    print_table(("quantity", "value", "unit", "change per period"), rows)

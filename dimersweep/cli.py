"""The command line: one run, a declared sweep, or the picture of a cube; heavy imports wait inside the commands."""

import inspect
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dimersweep.errors import ParameterError, Stopped, UserError
from dimersweep.symbols import BASE, PARAMETERS, QUANTITIES

if TYPE_CHECKING:
    import xarray as xr

    from dimersweep.declaration import Declaration
    from dimersweep.run import Run

INTERRUPTED = 130  # what a shell expects of a program that Ctrl-C has stopped
ORBIT = ("radius", "period", "zeta", "speed", "precession_rate", "impact_phase")

app = typer.Typer(
    help="Event-driven simulation of a 3D dimer on a vibrating plate.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _number(text: str | float) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a number") from None


def _whole(text: str | int) -> int:
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a whole number") from None


def _number_option(told: str, *names: str) -> Any:
    return typer.Option(*names, help=told, parser=_number, metavar="NUMBER")


def _whole_option(told: str) -> Any:
    return typer.Option(help=told, parser=_whole, metavar="COUNT")


Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]


def _with_parameters(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` an option for each parameter of the model, spelt as in the paper, in place of its keywords."""
    signature = inspect.signature(command)
    options = [parameter for parameter in signature.parameters.values() if parameter.kind is not parameter.VAR_KEYWORD]
    for name, (units, meaning) in PARAMETERS.items():
        told = meaning + ("" if units == "1" else f" ({units})") + ("" if name in BASE else "; as e by default")
        kind = Annotated[Any, _number_option(told, f"--{name}")]
        options.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=BASE.get(name), annotation=kind))
    command.__signature__ = signature.replace(parameters=options)  # type: ignore[attr-defined]
    command.__annotations__ = {option.name: option.annotation for option in options}
    return command


def _as_dict(run: "Run") -> dict[str, Any]:
    """What came out of `run`, as JSON can hold it."""
    outcome = {name: getattr(run, name) for name in ("parameters", "status", "message", "mode", "mode_period")}
    outcome |= {name: getattr(run, name) for name in ("n_events", "n_periods")}
    names = [*ORBIT, "di_end", "spin_rate", *(f"{name}_drift" for name in ORBIT)]
    return outcome | {"orbit": run.orbit and {name: getattr(run.orbit, name) for name in names}}


def _print_table(run: "Run") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table("quantity", "value", "unit", "change per period")
    repeats = f", repeats every {run.mode_period} periods" if run.mode_period > 1 else ""
    table.add_row("status", run.status if run.status == "ok" else f"{run.status}: {run.message}")
    table.add_row("mode", run.mode + repeats)
    table.add_row("forcing periods", str(run.n_periods))
    table.add_row("events", str(run.n_events))
    if run.orbit is not None:
        table.add_section()
        for name in ORBIT:
            value, drift = getattr(run.orbit, name), getattr(run.orbit, f"{name}_drift")
            table.add_row(name, f"{value:.8g}", QUANTITIES[name].units, f"{drift:.2e}")
        table.add_row("double impact ends", run.orbit.di_end)
    Console().print(table)


@app.command()
@_with_parameters
def simulate(
    *,
    periods: Annotated[int, _whole_option("Forcing periods to run.")] = 100,
    rtol: Annotated[float, _number_option("Accuracy, 1e-13 to 1e-2.")] = 1e-8,
    plot: Annotated[Path | None, typer.Option(help="Picture of heights, orbit and phase portraits.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON in place of the table.")] = False,
    force: Force = False,
    **parameters: Any,
) -> None:
    """Run one dimer and tell its mode and its orbit."""
    if plot is not None:
        from dimersweep.plots import check_picture

        check_picture(plot, force=force, name="plot")
    from dimersweep.parameters import Parameters, check_count, check_rtol
    from dimersweep.progress import tell_of_compiling

    # judged here as well, so that a typing error is told before seconds of imports and compiling
    Parameters(**parameters)
    check_count("periods", periods)
    check_rtol(rtol)
    tell_of_compiling()
    from dimersweep.run import simulate

    run = simulate(**parameters, periods=periods, rtol=rtol, record=plot is not None)
    if json:
        from json import dumps

        typer.echo(dumps(_as_dict(run), indent=1))
    else:
        _print_table(run)
    if plot is not None:
        from dimersweep.plots import run_figure

        run_figure(run).savefig(plot, dpi=150)


def _print_cube(cube: "xr.Dataset") -> None:
    """The tally of modes, or of a search's answers and runs; for segments, the length of each row."""
    from dimersweep.plots import drift_lengths
    from dimersweep.progress import Tally

    if "answer" in cube:
        from dimersweep.reading import answers_told

        typer.echo(answers_told(cube))
        return
    tally = Tally(cube["mode"].size)
    tally.add(cube["mode"].values)
    typer.echo(tally.words())
    if cube.attrs.get("plot") != "segments":
        return
    lengths = drift_lengths(cube)
    name = str(lengths.dims[0])
    units = PARAMETERS[name].units
    for value, length in zip(lengths[name].values, lengths.values, strict=True):
        typer.echo(f"{name} = {value:g} {units}: drift from {length:.4f} rad of initial dip angles")


@contextmanager
def _stoppable() -> Iterator[None]:
    """End the process on Ctrl-C or SIGTERM with one line and the exit code of the signal."""

    def terminate(number: int, frame: Any) -> None:
        raise Stopped("", number)

    signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except KeyboardInterrupt as stop:
        number = stop.signal if isinstance(stop, Stopped) else signal.SIGINT
        word = "interrupted" if number == signal.SIGINT else "terminated"
        print(f"dimersweep: {word}: {stop}".rstrip(": "), file=sys.stderr, flush=True)
        os._exit(128 + number)  # threads may be inside compiled code, which signals do not reach


def _declared(declaration: Path | None, source: Path | None, out: Path | None, *, other_kernel: bool) -> "Declaration":
    """The sweep that a file declares, or that a cube tells to have come from."""
    if (declaration is None) == (source is None):
        raise typer.BadParameter("give either SWEEP.toml or --from CUBE")
    if declaration is not None:
        from dimersweep.declaration import read_declaration

        return read_declaration(declaration)
    assert source is not None
    if out is None:
        raise typer.BadParameter("--from CUBE needs --out, the cube to write")
    from dimersweep.rerun import from_cube

    return from_cube(source, other_kernel=other_kernel)


Declared = Annotated[Path | None, typer.Argument(metavar="SWEEP.toml", help="Declaration of the sweep.")]
Workers = Annotated[int | None, _whole_option("Threads; one for each core by default.")]
Periods = Annotated[int | None, _whole_option("Forcing periods, in place of the declared ones.")]
Rtol = Annotated[float | None, _number_option("Accuracy, in place of the declared one.")]


@app.command()
def run(
    declaration: Declared = None,
    *,
    out: Annotated[Path | None, typer.Option(help="Cube to write, in place of the declared output.")] = None,
    source: Annotated[
        Path | None, typer.Option("--from", metavar="CUBE", help="Make this cube again, from what it tells of itself.")
    ] = None,
    workers: Workers = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a dask cluster, such as tcp://host:8786.")
    ] = None,
    periods: Periods = None,
    rtol: Rtol = None,
    extend: Annotated[Path | None, typer.Option(metavar="CUBE", help="Take over the points this cube has.")] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Run points that failed again.")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="Stop at the first point that fails.")] = False,
    keep_tiles: Annotated[bool, typer.Option("--keep-tiles", help="Keep the folder of finished points.")] = False,
    other_kernel: Annotated[
        bool, typer.Option("--other-kernel", help="With --from: go on though numbers may differ.")
    ] = False,
    plot: Annotated[bool, typer.Option(help="Draw the cube beside its file.")] = True,
    force: Force = False,
) -> None:
    """Run a declared sweep: write its cube and draw it. One that was stopped goes on where it was."""
    declared = _declared(declaration, source, out, other_kernel=other_kernel)
    from dimersweep.store import check_writable

    cube_file = out or Path(declared.sweep.output)
    picture = cube_file.with_suffix(".png")
    check_writable(cube_file, force=True)  # a cube that is there already is judged by `sweep`, which can read it
    if plot:
        check_writable(picture, force=force or retry, name="picture")
    with _stoppable():
        cube = _made(
            declared,
            cube_file,
            periods=declared.sweep.periods if periods is None else periods,
            rtol=declared.sweep.rtol if rtol is None else rtol,
            workers=workers,
            force=force,
            client=scheduler,
            extend=extend,
            retry=retry,
            fail_fast=fail_fast,
            keep_tiles=keep_tiles,
        )
        _print_cube(cube)
        typer.echo(f"cube: {cube_file}")
        if plot:
            _draw(cube, picture)


def _made(declared: "Declaration", out: Path, **options: Any) -> "xr.Dataset":
    """The cube of a declared sweep or search, written to `out`."""
    if declared.search is not None:
        from dimersweep.datasets import make

        taken = ("periods", "rtol", "workers", "force")
        refused = [name for name, value in options.items() if value and name not in taken]
        if refused:
            raise ParameterError(f"{refused[0]}: is for sweeps of a whole grid; a search does not take it")
        return make(declared, out, **{name: options[name] for name in taken})
    from dimersweep.sweeping import sweep

    return sweep(
        declared.grid,
        declared.fixed,
        out=out,
        stop_when_settled=declared.sweep.stop_when_settled,
        attrs={"title": declared.sweep.title, "plot": declared.plot.kind},
        **options,
    )


@app.command()
def plan(
    declaration: Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="Declaration of the sweep.")],
    *,
    workers: Workers = None,
    periods: Periods = None,
    rtol: Rtol = None,
) -> None:
    """Tell points, size and time of a declared sweep from a timed sample; nothing is written."""
    from dimersweep.declaration import read_declaration
    from dimersweep.progress import tell_of_compiling

    declared = read_declaration(declaration)
    if declared.search is not None:
        raise ParameterError("search: has no plan, as it stops as soon as its answers are certain; plan a whole grid")
    tell_of_compiling()
    from dask.system import CPU_COUNT

    from dimersweep.parameters import check_count
    from dimersweep.planning import plan
    from dimersweep.tiles import make_spec

    spec = make_spec(
        declared.grid,
        declared.fixed,
        periods=declared.sweep.periods if periods is None else periods,
        rtol=declared.sweep.rtol if rtol is None else rtol,
        stop_when_settled=declared.sweep.stop_when_settled,
    )
    threads = CPU_COUNT if workers is None else check_count("workers", workers)
    out = Path(declared.sweep.output)
    for line in plan(spec, threads, out).lines():
        typer.echo(line)


@app.command()
def status(
    out: Annotated[Path, typer.Argument(metavar="CUBE", help="Cube to be, as the sweep was given it.")],
) -> None:
    """Tell how far the sweep for a cube has come, and whether a process is at work on it."""
    from dimersweep.status import status

    for line in status(out):
        typer.echo(line)


def _draw(cube: "xr.Dataset", picture: Path) -> None:
    from dimersweep.plots import draw

    draw(cube).savefig(picture, dpi=150)
    typer.echo(f"picture: {picture}")


@app.command()
def plot(
    cube: Annotated[Path, typer.Argument(metavar="CUBE", help="Cube to draw.")],
    *,
    out: Annotated[Path | None, typer.Option(help="Picture; the cube's name with .png by default.")] = None,
    force: Force = False,
) -> None:
    """Draw a cube."""
    from dimersweep.plots import check_picture
    from dimersweep.store import open_cube

    picture = check_picture(out or cube.with_suffix(".png"), force=force)
    opened = open_cube(cube)
    _print_cube(opened)
    _draw(opened, picture)


@app.command()
def claims(
    *,
    out: Annotated[Path, typer.Option(help="Page to write, in Markdown.")] = Path("docs/claims.md"),
    small: Annotated[bool, typer.Option("--small", help="Coarse grids and short runs.")] = False,
    workers: Annotated[int | None, _whole_option("Threads; one for each core by default.")] = None,
    force: Force = False,
) -> None:
    """Recompute every checkable statement of the paper, tell where it holds, and write the page of all of them."""
    from dimersweep.store import check_writable

    page = check_writable(out, force=force)
    from time import perf_counter

    from rich.console import Console
    from rich.table import Table

    from dimersweep.claims import Lab, as_markdown, made, radius_study
    from dimersweep.progress import tell_of_compiling

    tell_of_compiling()
    started, lab, rows = perf_counter(), Lab(small=small, workers=workers), []
    for row in made(lab):
        rows.append(row)
        typer.echo(f"{len(rows)}: Sect. {row.section}, {row.finding.verdict}: {row.statement}", err=True)
    study = radius_study(lab)
    table = Table("Sect.", "the paper says", "here", "verdict", show_lines=True)
    for row in rows:
        table.add_row(row.section, row.statement, row.finding.value, row.finding.verdict)
    Console().print(table)
    page.write_text(as_markdown(rows, study, lab, started), encoding="utf-8")
    typer.echo(f"page: {page}")


def _show_version(wanted: bool) -> None:
    if wanted:
        from dimersweep import __version__

        typer.echo(f"dimersweep {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _top(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Version.")] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _fail(message: str) -> None:
    print(f"dimersweep: error: {message}", file=sys.stderr)
    sys.exit(2)


def _warn(message: Warning | str, *others: Any, **more: Any) -> None:
    print(f"dimersweep: warning: {message}", file=sys.stderr, flush=True)


def main() -> None:
    """Entry point: every error that is the user's to mend is told in a line and exit code 2."""
    import warnings

    warnings.showwarning = _warn
    try:
        code = app(prog_name="dimersweep", standalone_mode=False)
    except UserError as error:
        _fail(str(error))
    except Exception as error:
        if not hasattr(error, "format_message"):  # of a usage error; its class moved between versions of typer
            raise
        _fail(" ".join(error.format_message().split()))
    if code == INTERRUPTED:
        print("dimersweep: interrupted, nothing was written", file=sys.stderr)
        os._exit(INTERRUPTED)  # threads may be inside compiled code, which Ctrl-C does not reach

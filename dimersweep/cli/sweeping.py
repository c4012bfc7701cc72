"""The commands for declared sweeps and borders: run one, say what it would cost, show how far it is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dimersweep.cli.drawing import check_kind, check_picture_of, draw_if_it_can, print_cube
from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import Force, Periods, Rtol, Workers, argument, option

if TYPE_CHECKING:
    from dimersweep.studies.declared import Declaration

PRESET = "Declaration of the sweep: a file, or a preset such as fig07."

Carry = Annotated[
    str | None,
    option("Carry the state on along the last axis, from value to value: for hysteresis.", metavar="up|down|both"),
]
Observe = Annotated[
    str | None,
    option("Observer of your own: what it makes of each run stands in the cube.", metavar="MODULE:NAME"),
]
Declared = Annotated[Path | None, argument("SWEEP.toml", PRESET)]


def run(
    declaration: Declared = None,
    *,
    out: Annotated[Path | None, option("Cube to write, in place of the declared output.")] = None,
    source: Annotated[
        Path | None, option("Make this cube again, from the configuration in it.", "--from", metavar="CUBE")
    ] = None,
    workers: Workers = None,
    scheduler: Annotated[
        str | None, option("Scheduler of a dask cluster, such as tcp://host:8786.", metavar="ADDRESS")
    ] = None,
    periods: Periods = None,
    rtol: Rtol = None,
    extend: Annotated[Path | None, option("Take over the points this cube has.", metavar="CUBE")] = None,
    retry: Annotated[bool, option("Run points that failed again.", "--retry")] = False,
    fail_fast: Annotated[bool, option("Stop at the first point that fails.", "--fail-fast")] = False,
    keep_tiles: Annotated[bool, option("Keep the store of finished points.", "--keep-tiles")] = False,
    other_kernel: Annotated[bool, option("With --from: go on though numbers may differ.", "--other-kernel")] = False,
    certify: Annotated[bool, option("Say how sure each mode is; about 2.5 times the time.", "--certify")] = False,
    carry: Carry = None,
    observe: Observe = None,
    plot: Annotated[bool, option("Draw the cube beside its file.")] = True,
    force: Force = False,
) -> None:
    """Run a declared sweep: write its cube and draw it. One that was stopped goes on where it was."""
    declared = _declared(declaration, source, out, other_kernel=other_kernel)
    from dimersweep.storage.outputs import check_output
    from dimersweep.storage.tilestore import tiles_of

    cube_file = out or Path(declared.sweep.output)
    check_output(cube_file, force=True)  # a cube that is there already is checked where it can be read
    picture, forced = cube_file.with_suffix(".png"), force or retry
    with interruptible(
        cube_file, picture if plot else None, parts=tiles_of(cube_file), again="run the same again for the rest"
    ):
        from dimersweep.storage.provenance import as_text, digest
        from dimersweep.studies.making import make_cube

        study = declared.study(periods=periods, rtol=rtol, certify=certify, carry=carry, observe=_here(observe))
        if plot and not cube_file.exists():
            check_kind(declared, study)
            check_picture_of(digest(as_text(study.configuration())), picture, force=forced)
        cube = make_cube(
            study,
            out=cube_file,
            attrs=declared.attrs,
            extend=extend,
            retry=retry,
            workers=workers,
            client=scheduler,
            fail_fast=fail_fast,
            force=force,
            keep_tiles=keep_tiles,
        )
        print_cube(cube)
        typer.echo(f"cube: {cube_file}")
        if plot:
            draw_if_it_can(cube, picture, force=forced)


def _declared(
    declaration: Path | None, source: Path | None = None, out: Path | None = None, *, other_kernel: bool = False
) -> "Declaration":
    """The sweep that a file declares, or that a cube was made from."""
    if (declaration is None) == (source is None):
        raise typer.BadParameter("give either SWEEP.toml or --from CUBE")
    if declaration is None and out is None:
        raise typer.BadParameter("--from CUBE needs --out, the cube to write")
    from dimersweep.studies.declared import from_cube, read_declaration
    from dimersweep.studies.presets import find_declaration

    if declaration is not None:
        return read_declaration(find_declaration(declaration))
    assert source is not None
    return from_cube(source, other_kernel=other_kernel)


def _here(observe: str | None) -> str | None:
    """An observer that is named, whose module is looked for in the working folder, too."""
    from dimersweep.studies.observing import look_in

    look_in(Path())
    return observe


def plan(
    declaration: Annotated[Path, argument("SWEEP.toml", PRESET)],
    *,
    workers: Workers = None,
    periods: Periods = None,
    rtol: Rtol = None,
    carry: Carry = None,
    observe: Observe = None,
) -> None:
    """Print points, size and time of a declared sweep from a timed sample; nothing is written."""
    from dimersweep.studies.planning import plan
    from dimersweep.work.options import make_options
    from dimersweep.work.progress import report_compiling

    declared = _declared(declaration)
    study = declared.study(periods=periods, rtol=rtol, carry=carry, observe=_here(observe))
    threads = make_options(workers=workers).workers
    report_compiling()
    for line in plan(study, threads, Path(declared.sweep.output)).lines():
        typer.echo(line)


def status(out: Annotated[Path, argument("CUBE", "Path of the cube that the sweep writes, finished or not.")]) -> None:
    """Print how far the sweep for a cube has come, and whether a process is at work on it."""
    from dimersweep.studies.status import status

    for line in status(out):
        typer.echo(line)


def presets(
    name: Annotated[str | None, argument("NAME", "Preset whose file is printed, to be changed.")] = None,
) -> None:
    """List the sweeps that come with the program, or print one of them."""

    from dimersweep.inputs import read_text, read_toml
    from dimersweep.studies.presets import find_declaration
    from dimersweep.studies.presets import presets as all_presets

    if name is not None:
        typer.echo(read_text(find_declaration(Path(name))).rstrip())
        return
    known = all_presets()
    width = max(map(len, known), default=0)
    for each, path in known.items():
        typer.echo(f"{each:{width}}  {read_toml(path)['sweep'].get('title', '')}")


def borders(
    declaration: Annotated[Path, argument("FILE", "Borders to make, such as sweeps/borders/atlas.toml.")],
    *,
    out: Annotated[Path | None, option("NetCDF file, in place of the declared one.")] = None,
    picture: Annotated[Path | None, option("Picture; the output's name with .png by default.")] = None,
    over: Annotated[Path | None, option("Map of regions to draw curves over.", metavar="CUBE")] = None,
    plan: Annotated[bool, option("Print the parts and which are there; make nothing.", "--plan")] = False,
    force: Force = False,
) -> None:
    """Make borders, branches or families of orbits, and draw them. One that was stopped goes on where it was."""
    from dimersweep.plots.style import check_picture, write_picture
    from dimersweep.storage.cubefiles import open_cube
    from dimersweep.storage.outputs import TABLES, check_output, refuse_input
    from dimersweep.studies.border_files import make_borders, parts_of, plan_borders, read_borders
    from dimersweep.work.progress import report_compiling

    declared = read_borders(declaration)
    out = out or Path(declared.borders.output)
    if plan:
        for line in plan_borders(declared, out):
            typer.echo(line)
        return
    check_output(out, force=force, what="a table", endings=TABLES)
    drawn = check_picture(picture or out.with_suffix(".png"), force=force, name="picture")
    if over is not None:
        refuse_input(out, over)
    under = open_cube(over) if over is not None else None
    with interruptible(out, drawn, parts=parts_of(out)):
        from dimersweep.orbits.pictures import draw_borders

        report_compiling()
        table = make_borders(declared, out, force=force, tell=typer.echo)
        write_picture(draw_borders(table, under), drawn, force=force)
        typer.echo(f"{out} and {drawn} in {table.attrs['wall_time_s']:.1f} s")

"""The commands for declared sweeps: run one, merge its parts, estimate its cost, show its progress."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dimersweep.cli.drawing import check_kind, check_picture_of, show_written
from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, Force, Periods, Rtol, Workers, argument, option
from dimersweep.studies.presets import find_declaration
from dimersweep.studies.presets import presets as all_presets

if TYPE_CHECKING:
    from dimersweep.studies.declared import Declaration

PRESET = "Declaration of the sweep: a file, or a preset such as fig07 (`dimersweep presets` has all)."

Carry = Annotated[
    str | None,
    option("Carry the state on along the last axis, from value to value: for hysteresis.", metavar="up|down|both"),
]
Observe = Annotated[
    str | None,
    option("Observer of your own: what it makes of each run stands in the cube.", metavar="MODULE:NAME"),
]
Declared = Annotated[Path | None, argument("SWEEP.toml", PRESET, words=all_presets)]


def run(
    context: typer.Context,
    declaration: Declared = None,
    *,
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
    keep_tiles: Annotated[bool, option("Keep the store of finished points.", "--keep-tiles", group=OUTPUT)] = False,
    other_kernel: Annotated[bool, option("With --from: go on though numbers may differ.", "--other-kernel")] = False,
    certify: Annotated[bool, option("Say how sure each mode is; about 2.5 times the time.", "--certify")] = False,
    carry: Carry = None,
    observe: Observe = None,
    give_up_after: Annotated[
        str | None, option("End when nothing has come back for so long, such as 30min.", metavar="TIME")
    ] = None,
    part: Annotated[
        str | None, option("Run one part of the sweep, such as 3/20, for merge; it is not drawn.", metavar="K/N")
    ] = None,
    out: Annotated[Path | None, option("Cube to write, in place of the declared output.", group=OUTPUT)] = None,
    plot: Annotated[bool, option("Draw the cube beside its file.", group=OUTPUT)] = True,
    force: Force = False,
) -> None:
    """Run a declared sweep: write its cube and draw it. One that was stopped goes on where it was."""
    tell, _ = context.obj
    declared = _declared(declaration, source, out, other_kernel=other_kernel)
    from dimersweep.storage.outputs import check_output
    from dimersweep.storage.tilestore import tiles_of
    from dimersweep.work.parts import SweepPart

    whole_file = out or Path(declared.sweep.output)
    cube_file, plot = (whole_file, plot) if part is None else (SweepPart.of(part).file(whole_file), False)
    check_output(cube_file, force=True)  # an existing cube is checked by `make_cube`, which reads it
    picture, forced = cube_file.with_suffix(".png"), force or retry
    with interruptible(
        cube_file, picture if plot else None, parts=tiles_of(cube_file), again="run the same again for the rest"
    ):
        from dimersweep.storage.provenance import as_text, digest
        from dimersweep.studies.making import make_cube

        study = declared.study(periods=periods, rtol=rtol, certify=certify, carry=carry, observe=observe)
        if plot and not cube_file.exists():
            # with --from the kind is that of the first cube: if it cannot be drawn, a warning is enough
            if source is None:
                check_kind(declared, study)
            check_picture_of(digest(as_text(study.configuration())), picture, force=forced)
        cube = make_cube(
            study,
            out=whole_file,
            attrs=declared.attrs,
            extend=extend,
            retry=retry,
            workers=workers,
            client=scheduler,
            fail_fast=fail_fast,
            force=force,
            keep_tiles=keep_tiles,
            give_up_after=give_up_after,
            part=part,
            progress=not tell.quiet,
        )
        show_written(tell, cube, cube_file, picture if plot else None, force=forced)


def merge(
    context: typer.Context,
    parts: Annotated[list[Path], argument("PART...", "Files of all parts of a sweep, in any order.")],
    *,
    out: Annotated[Path, option("Cube to write.", group=OUTPUT)],
    finish: Annotated[bool, option("Make the parts that are missing first.", "--finish")] = False,
    workers: Workers = None,
    plot: Annotated[bool, option("Draw the cube beside its file.", group=OUTPUT)] = True,
    force: Force = False,
) -> None:
    """Make one cube of the parts of a sweep, which run --part has made, and draw it."""
    tell, _ = context.obj
    picture = out.with_suffix(".png") if plot else None
    with interruptible(out, picture, again="run the same again with --force"):
        from dimersweep.studies.merging import merge

        cube = merge(parts, out, finish=finish, force=force, workers=workers, progress=not tell.quiet)
        show_written(tell, cube, out, picture, force=force)


def _declared(
    declaration: Path | None, source: Path | None = None, out: Path | None = None, *, other_kernel: bool = False
) -> "Declaration":
    """Return the declaration in a file, or the declaration that makes the cube `source` again.

    Modules of observers are searched for in the working folder, too.
    """
    if (declaration is None) == (source is None):
        raise typer.BadParameter("give either SWEEP.toml or --from CUBE")
    if declaration is None and out is None:
        raise typer.BadParameter("--from CUBE needs --out, the cube to write")
    from dimersweep.studies.declared import from_cube, read_declaration
    from dimersweep.studies.observing import look_in

    if source is not None:
        declared = from_cube(source, other_kernel=other_kernel)
    elif declaration is not None:
        declared = read_declaration(find_declaration(declaration))
    look_in(Path())
    return declared


def plan(
    context: typer.Context,
    declaration: Annotated[Path, argument("SWEEP.toml", PRESET, words=all_presets)],
    *,
    workers: Workers = None,
    periods: Periods = None,
    rtol: Rtol = None,
    carry: Carry = None,
    observe: Observe = None,
) -> None:
    """Print points, size and time of a declared sweep from a timed sample; nothing is written."""
    tell, _ = context.obj
    from dimersweep.studies.planning import plan
    from dimersweep.work.options import make_options

    declared = _declared(declaration)
    study = declared.study(periods=periods, rtol=rtol, carry=carry, observe=observe)
    threads = make_options(workers=workers).workers
    tell.report_compiling()
    made = plan(study, threads, Path(declared.sweep.output))
    tell(*made.lines(), **made.as_dict())


def status(
    context: typer.Context,
    out: Annotated[Path, argument("CUBE", "Path of the cube that the sweep writes, finished or not.")],
) -> None:
    """Print how far the sweep for a cube has come, and whether a process is at work on it."""
    tell, _ = context.obj
    from dimersweep.studies.status import status, status_lines

    state = status(out)
    tell(*status_lines(state), **state)


def presets(
    context: typer.Context,
    name: Annotated[
        str | None, argument("NAME", "Preset whose file is printed, to be changed.", words=all_presets)
    ] = None,
) -> None:
    """List the sweeps that come with the program, or print one of them."""
    tell, _ = context.obj
    from dimersweep.inputs import read_text, read_toml

    known = all_presets() | {f"borders/{each}": path for each, path in all_presets("borders").items()}
    if name is not None:
        text = read_text(known.get(name) or find_declaration(Path(name))).rstrip()
        tell(text, name=name, text=text)
        return
    width = max(map(len, known), default=0)
    for each, path in known.items():
        read = read_toml(path)
        title = read.get("sweep", read.get("borders", {})).get("title", "")
        tell(f"{each:{width}}  {title}", **{each: title})


def warm(context: typer.Context) -> None:
    """Compile the kernel, unless that was done before: for a job's prologue, or an image."""
    tell, _ = context.obj
    from dimersweep.kernel import kernel_version
    from dimersweep.work.computing import prepare_kernel

    prepare_kernel(progress=not tell.quiet)
    tell(f"kernel {kernel_version()}: is ready", kernel_version=kernel_version())

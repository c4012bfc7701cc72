"""The command for borders, branches and families of orbits."""

from pathlib import Path
from typing import Annotated

import typer

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import Force


def borders(
    declaration: Annotated[
        Path, typer.Argument(metavar="FILE", help="Borders to make, such as sweeps/borders/atlas.toml.")
    ],
    *,
    out: Annotated[Path | None, typer.Option(help="NetCDF file, in place of the declared one.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Picture; the output's name with .png by default.")] = None,
    over: Annotated[Path | None, typer.Option(metavar="CUBE", help="Map of regions to draw curves over.")] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Print the parts and which are there; make nothing.")] = False,
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

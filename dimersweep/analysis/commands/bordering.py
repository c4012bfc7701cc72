"""The command for files of borders."""

from pathlib import Path
from typing import Annotated

import typer

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, Force, argument, option
from dimersweep.studies.presets import find_declaration
from dimersweep.studies.presets import presets as all_presets


def borders(
    context: typer.Context,
    declaration: Annotated[
        Path,
        argument(
            "FILE",
            "Declaration of borders: a file, or one that comes along, such as atlas.",
            words=lambda: all_presets("borders"),
        ),
    ],
    *,
    out: Annotated[Path | None, option("NetCDF file, in place of the declared one.", group=OUTPUT)] = None,
    picture: Annotated[Path | None, option("Picture; the output's name with .png by default.", group=OUTPUT)] = None,
    over: Annotated[Path | None, option("Map of regions to draw curves over.", group=OUTPUT, metavar="CUBE")] = None,
    plan: Annotated[bool, option("Print the parts and which are there; make nothing.", "--plan")] = False,
    force: Force = False,
) -> None:
    """Make borders, branches or families of orbits, and draw them. One that was stopped goes on where it was."""
    tell, _ = context.obj
    from dimersweep.analysis.borders.border_files import make_borders, parts_of, plan_borders, read_borders
    from dimersweep.plots.style import check_picture, write_picture
    from dimersweep.storage.cubefiles import open_cube
    from dimersweep.storage.outputs import TABLES, check_output, refuse_input

    declared = read_borders(find_declaration(declaration, "borders"))
    out = out or Path(declared.borders.output)
    if plan:
        lines = plan_borders(declared, out)
        tell(*lines, plan=lines)
        return
    check_output(out, force=force, what="a table", endings=TABLES)
    drawn = check_picture(picture or out.with_suffix(".png"), force=force, name="picture")
    if over is not None:
        refuse_input(out, over)
    under = open_cube(over) if over is not None else None
    with interruptible(out, drawn, parts=parts_of(out)):
        from dimersweep.analysis.orbits.borders.pictures import draw_borders

        tell.report_compiling()
        table = make_borders(declared, out, force=force, tell=tell)
        write_picture(draw_borders(table, under), drawn, force=force)
        seconds = table.attrs["wall_time_s"]
        tell(f"{out} and {drawn} in {seconds:.1f} s", table=str(out), picture=str(drawn), seconds=seconds)

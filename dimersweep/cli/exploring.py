"""The command for a map to click."""

from pathlib import Path
from typing import Annotated

import typer

from dimersweep.cli.options import whole_option
from dimersweep.errors import ParameterError

LAST_PORT = 65535


def explore(
    cube: Annotated[Path, typer.Argument(metavar="CUBE", help="Cube to look at.")],
    *,
    port: Annotated[int, whole_option("Port of the page; 0 for any that is free.")] = 0,
    show: Annotated[bool, typer.Option(help="Open a browser.")] = True,
) -> None:
    """Look at a cube in a browser: a map to click, and the run behind each point."""
    if not 0 <= port <= LAST_PORT:
        raise ParameterError(f"port = {port}: must be 0 to {LAST_PORT}")
    from dimersweep.exploring.serving import serve
    from dimersweep.storage.cubefiles import open_cube

    serve(open_cube(cube), port=port, show=show)

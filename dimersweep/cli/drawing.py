"""The command for the picture of a cube, and what every command that has a cube tells of it."""

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dimersweep.cli.options import Force
from dimersweep.symbols import PARAMETERS

if TYPE_CHECKING:
    import xarray as xr


def plot(
    cube: Annotated[Path, typer.Argument(metavar="CUBE", help="Cube to draw.")],
    *,
    out: Annotated[Path | None, typer.Option(help="Picture; the cube's name with .png by default.")] = None,
    force: Force = False,
) -> None:
    """Draw a cube."""
    from dimersweep.plots import check_picture
    from dimersweep.storage.netcdf import open_cube

    if out is None and not cube.name:
        raise typer.BadParameter(f"{str(cube)!r}: is no cube")
    picture = check_picture(out or cube.with_suffix(".png"), force=force)
    opened = open_cube(cube)
    print_cube(opened)
    draw_beside(opened, picture)


def draw_beside(cube: "xr.Dataset", picture: Path) -> None:
    """Draw `cube` to a file that may be replaced, marked with what it was drawn from, and tell of it."""
    from dimersweep.plots import draw

    draw(cube).savefig(picture, dpi=150, metadata={"Keywords": _mark(cube.attrs["configuration_sha256"])})
    typer.echo(f"picture: {picture}")


def _mark(configuration_sha256: str) -> str:
    return f"dimersweep cube, configuration sha256 {configuration_sha256}"


def check_picture_of(configuration: Callable[[], Mapping[str, Any]], picture: Path, *, force: bool) -> None:
    """Refuse to replace a picture, unless it was drawn from a cube of this configuration: then nothing is lost.

    Raises
    ------
    StoreError
    """
    from dimersweep.storage.netcdf import check_writable
    from dimersweep.storage.provenance import as_text, digest

    check_writable(picture, force=True, name="picture")  # to look into a device might take for ever
    ours = picture.exists() and _mark_in(picture) == _mark(digest(as_text(configuration())))
    check_writable(picture, force=force or ours, name="picture")


def _mark_in(picture: Path) -> str | None:
    from PIL import Image

    try:
        with Image.open(picture) as image:
            return image.info.get("Keywords")
    except OSError:  # there is none, or no picture
        return None


def print_cube(cube: "xr.Dataset") -> None:
    """The tally of modes, or of a search's answers and runs; for segments, the length of each row."""
    from dimersweep.plots import drift_lengths
    from dimersweep.work.progress import Tally

    if "answer" in cube:
        from dimersweep.cubes.reading import answers_told

        typer.echo(answers_told(cube))
        return
    tally = Tally(cube["mode"].size)
    tally.add(cube["mode"].values)
    typer.echo(tally.words())
    if "confidence" in cube:
        from dimersweep.cubes.cube import names

        sure = Counter(names(cube["confidence"]).values.ravel().tolist())
        typer.echo("modes that are " + ", ".join(f"{word} {count}" for word, count in sure.most_common()))
    if cube.attrs.get("plot") != "segments":
        return
    lengths = drift_lengths(cube)
    name = str(lengths.dims[0])
    units = PARAMETERS[name].units
    for value, length in zip(lengths[name].values, lengths.values, strict=True):
        typer.echo(f"{name} = {value:g} {units}: drift from {length:.4f} rad of initial dip angles")

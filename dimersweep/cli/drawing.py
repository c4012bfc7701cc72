"""The commands for the picture of a cube and for the page to play with, and what every command prints of its cube."""

import warnings
from collections import Counter
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import Force, argument, number_option, option
from dimersweep.errors import ParameterError
from dimersweep.symbols import PARAMETERS

PICTURE_MARK = "dimersweep cube, configuration sha256 "  # in a picture, before that of the cube it was drawn from
LAST_PORT = 65535

if TYPE_CHECKING:
    import xarray as xr

    from dimersweep.studies.declared import Declaration
    from dimersweep.studies.study import Study


def plot(
    cube: Annotated[Path, argument("CUBE", "Cube to draw.")],
    *,
    out: Annotated[Path | None, option("Picture; the cube's name with .png by default.")] = None,
    kind: Annotated[str | None, option("Kind of picture, in place of the declared one.")] = None,
    quantity: Annotated[str | None, option("Draw a map of this variable, such as radius.")] = None,
    select: Annotated[
        list[str] | None,
        option("Keep the nearest value of an axis, such as f=15 or beta0=16deg.", metavar="NAME=VALUE"),
    ] = None,
    force: Force = False,
) -> None:
    """Draw a cube: as it was declared, or another kind, a quantity, a selection."""
    from dimersweep.plots import check_picture
    from dimersweep.storage.cubefiles import open_cube
    from dimersweep.storage.outputs import refuse_input

    if out is None and not cube.name:
        raise typer.BadParameter(f"{str(cube)!r}: is no cube")
    picture = check_picture(out or cube.with_suffix(".png"), force=force)
    refuse_input(picture, cube)
    with interruptible(picture):
        opened = open_cube(cube)
        for each in select or ():
            opened = _selected(opened, each)
        print_cube(opened)
        draw_beside(opened, picture, kind, quantity)


def explore(
    cube: Annotated[Path | None, argument("CUBE", "Cube whose map stands beside the dimer.")] = None,
    *,
    port: Annotated[
        int | None, number_option("Port of the page, 0 for any that is free; 8470 by default, if it is.", int)
    ] = None,
    show: Annotated[bool, option("Open a browser.")] = True,
) -> None:
    """Play with a dimer in a browser: it moves as its sliders do, or as a point of a map is clicked."""
    if port is not None and not 0 <= port <= LAST_PORT:
        raise ParameterError(f"port = {port}: must be 0 to {LAST_PORT}")
    from dimersweep.work.progress import report_compiling

    opened = None
    if cube is not None:
        from dimersweep.storage.cubefiles import open_cube

        opened = open_cube(cube)
    report_compiling()
    from dimersweep.exploring.serving import Explorer

    explorer = Explorer(opened, port)
    typer.echo(f"{explorer.address} (Ctrl-C ends it)")
    if show:
        import webbrowser

        webbrowser.open(explorer.address)
    explorer.wait()


def _selected(cube: "xr.Dataset", text: str) -> "xr.Dataset":
    """`cube` at the value of an axis that is nearest to the one in `text`, such as f=15."""
    from dimersweep.cubes.findings import nearest

    name, _, value = text.partition("=")
    if name not in cube.dims:
        allowed = ", ".join(map(str, cube["mode"].dims))
        raise typer.BadParameter(f"--select {text}: {name or 'nothing'} is no axis of the cube ({allowed})")
    return nearest(cube, name, value)


def draw_beside(cube: "xr.Dataset", picture: Path, kind: str | None = None, quantity: str | None = None) -> None:
    """Draw `cube` to a file that may be replaced, marked with what it was drawn from, and print its path."""
    from dimersweep.plots import draw, write_picture

    marked = {"Keywords": PICTURE_MARK + cube.attrs["configuration_sha256"]}
    write_picture(draw(cube, kind, quantity=quantity), picture, force=True, metadata=marked)
    typer.echo(f"picture: {picture}")


def draw_if_it_can(cube: "xr.Dataset", picture: Path, *, force: bool) -> None:
    """Draw a cube that was just written: a picture that fails gives a warning, and the command still succeeds."""
    try:
        check_picture_of(cube.attrs["configuration_sha256"], picture, force=force)
        draw_beside(cube, picture)
    except Exception as error:
        warnings.warn(f"{picture}: was not drawn ({error})", RuntimeWarning, stacklevel=2)


def check_kind(declared: "Declaration", study: "Study") -> None:
    """Refuse a declared kind of picture that the cube of `study` will not fit.

    Raises
    ------
    ParameterError
    """
    from dimersweep.plots.checking import check

    if "plot" not in declared.model_fields_set:
        return
    sweep, kind = declared.sweep, declared.attrs["plot"]
    asked = {"search": declared.search, "paths": declared.paths, "strobes": sweep.strobes, "sustained": sweep.sustained}
    sizes = {name: values.size for name, values in study.grid.axes.items()}
    try:
        check(kind, sizes, {feature for feature, given in asked.items() if given})
    except ParameterError as error:
        raise ParameterError(f"plot.kind = {kind!r}: {error}; another kind, or --no-plot") from None


def check_picture_of(configuration_sha256: str, picture: Path, *, force: bool) -> None:
    """Refuse to replace a picture, unless it was drawn from a cube of this configuration: then nothing is lost.

    Raises
    ------
    StoreError
    """
    from dimersweep.storage.outputs import check_output

    check_output(picture, force=True, name="picture", endings=None)  # to look into a device might take for ever
    ours = _mark_in(picture) == PICTURE_MARK + configuration_sha256
    check_output(picture, force=force or ours, name="picture", endings=None)


def _mark_in(picture: Path) -> str | None:
    from PIL import Image

    try:
        with Image.open(picture) as image:
            return image.info.get("Keywords")
    except OSError:  # there is none, or no picture
        return None


def print_cube(cube: "xr.Dataset") -> None:
    """The tally of modes, or of a search's answers and runs; for segments, the length of each row."""
    from dimersweep.cubes.cube import names
    from dimersweep.cubes.findings import drift_lengths, search_summary
    from dimersweep.storage.cubefiles import modes_in

    if "observer_error" in cube:
        _print_errors(cube["observer_error"])
    if "answer" in cube:
        typer.echo(search_summary(cube))
        return
    typer.echo(", ".join(f"{mode} {count}" for mode, count in modes_in(cube).items()))
    if "confidence" in cube:
        sure = Counter(names(cube["confidence"]).values.ravel().tolist())
        typer.echo("modes that are " + ", ".join(f"{word} {count}" for word, count in sure.most_common()))
    if cube.sizes.get("direction", 0) > 1:
        _print_loops(cube)
    if cube.attrs.get("plot") != "segments" or "beta0" not in cube["mode"].dims or cube["mode"].squeeze().ndim > 2:
        return
    lengths = drift_lengths(cube)
    name = str(lengths.dims[0])
    units = PARAMETERS[name].units
    for value, length in zip(lengths[name].values, lengths.values, strict=True):
        typer.echo(f"{name} = {value:g} {units}: initial dip angles that drift make up {length:.4f} rad in all")


def _print_errors(errors: "xr.DataArray") -> None:
    """What an observer of one's own has raised, each with the number of points."""
    told = Counter(text.decode() for text in errors.values.ravel().tolist() if text)
    for text, count in told.most_common():
        typer.echo(f"status observer {count}: {text}")


def _print_loops(cube: "xr.Dataset") -> None:
    """Where going up and going down lead to different motions, a line for each loop."""
    from dimersweep.studies.loops import loops
    from dimersweep.symbols import given

    found = loops(cube)
    for k in range(found.sizes["loop"]):
        loop = found.isel(loop=k)
        where = ", ".join(
            given(str(name), loop[name].item()) for name in loop.coords if name in PARAMETERS and found[name].ndim
        )
        ends = " to ".join(_end(loop, which) for which in ("low", "high"))
        typer.echo(f"{where + ': ' if where else ''}up and down differ from {found.attrs['axis']} = {ends}")


def _end(loop: "xr.Dataset", which: str) -> str:
    """One end of a loop, with the step that it lies in, such as 0.785 ± 0.005."""
    value = loop[which].item()
    return f"{value:.6g} ± {loop[f'{which}_error'].item():.2g}" if isfinite(value) else "beyond the axis"

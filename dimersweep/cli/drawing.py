"""The commands that draw a cube and serve the page, and functions with which commands keep and print their results."""

import warnings
from collections import Counter
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, Force, argument, number_option, option
from dimersweep.cli.printing import Printer
from dimersweep.errors import ParameterError, unknown
from dimersweep.symbols import ORBIT_NAMES, PARAMETERS, PICTURE_KINDS, QUANTITIES, parameter_shown

# mark in the metadata of a picture, followed by the checksum of the cube that is drawn
PICTURE_MARK = "dimersweep cube, configuration sha256 "
LAST_PORT = 65535  # ports are numbers of 16 bits

if TYPE_CHECKING:
    import xarray as xr

    from dimersweep.studies.declared import Declaration
    from dimersweep.studies.study import Study


def check_files(
    out: Path | None, plot: Path | None, *, force: bool, what: str = "a table", endings: tuple[str, ...] = ()
) -> None:
    """Refuse a table or a picture that could not be written; `endings` are those allowed, by default of tables."""
    from dimersweep.plots import check_picture
    from dimersweep.storage.outputs import TABLES, check_output

    if out is not None:
        check_output(out, force=force, what=what, endings=endings or TABLES)
    if plot is not None:
        check_picture(plot, force=force, name="plot")


def keep(tell: Printer, made: Any, out: Path | None, plot: Path | None, *, force: bool, noun: str = "table") -> None:
    """Write a table (or an object that saves itself) to `out` and its picture to `plot`, if these are not None."""
    from dimersweep.plots import write_picture

    made = getattr(made, "dimersweep", made)
    if out is not None:
        made.save(out, force=force)
        tell(f"{noun}: {out}", **{noun: str(out)})
    if plot is not None:
        write_picture(made.plot(), plot, force=force)
        tell(f"picture: {plot}", picture=str(plot))


def plot(
    context: typer.Context,
    cube: Annotated[Path, argument("CUBE", "Cube to draw, or borders, branches, families of orbits.")],
    *,
    kind: Annotated[
        str | None,
        option(f"Kind, in place of the declared one: {', '.join(PICTURE_KINDS)}.", words=lambda: PICTURE_KINDS),
    ] = None,
    quantity: Annotated[
        str | None,
        option(f"Draw a map of a variable of the cube: {', '.join(ORBIT_NAMES)}, ...", words=lambda: QUANTITIES),
    ] = None,
    select: Annotated[
        list[str] | None,
        option(
            "Keep the nearest value of an axis, such as f=15 or beta0=16deg.",
            metavar="NAME=VALUE",
            words=lambda: (f"{name}=" for name in PARAMETERS),
        ),
    ] = None,
    out: Annotated[
        Path | None, option("Picture; by default CUBE.png, or CUBE-KIND.png, CUBE-QUANTITY.png.", group=OUTPUT)
    ] = None,
    force: Force = False,
) -> None:
    """Draw a cube: as it was declared, or another kind, a quantity, a selection."""
    tell, _ = context.obj
    if kind is not None and kind not in PICTURE_KINDS:
        raise ParameterError(f"kind: {unknown(kind, 'kind of picture', PICTURE_KINDS)}")
    from dimersweep.plots import check_picture
    from dimersweep.storage.cubefiles import open_result
    from dimersweep.storage.outputs import refuse_input

    if not cube.name:
        raise typer.BadParameter(f"{str(cube)!r}: is no cube")
    if out is not None:
        check_picture(out, force=True)  # first: a wrong ending is refused before a large cube is read
    opened = open_result(cube)
    if quantity is not None and quantity not in opened:
        raise ParameterError(f"quantity: {unknown(quantity, 'variable of the cube', map(str, opened.data_vars))}")
    which = quantity or kind
    picture = out or (cube.with_name(f"{cube.stem}-{which}.png") if which else cube.with_suffix(".png"))
    picture = check_picture(picture, force=force)
    refuse_input(picture, cube)
    with interruptible(picture):
        for each in select or ():
            opened = _selected(opened, each)
        if opened.dimersweep.is_cube:
            print_cube(tell, opened)
        draw_marked(tell, opened, picture, kind, quantity)


def explore(
    cube: Annotated[
        Path | None, argument("CUBE", "Cube, or borders or branches, whose map stands beside the dimer.")
    ] = None,
    *,
    port: Annotated[
        int | None, number_option("Port of the page, 0 for any that is free; 8470 by default, if it is.", int)
    ] = None,
    show: Annotated[bool, option("Open a browser.")] = True,
) -> None:
    """Play with a dimer in a browser: it moves as its sliders do, or as a point of a map is clicked."""
    if port is not None and not 0 <= port <= LAST_PORT:
        raise ParameterError(f"port = {port}: must be 0 to {LAST_PORT}")
    with interruptible():
        from dimersweep.storage.cubefiles import open_result
        from dimersweep.work.progress import report_compiling

        opened = None if cube is None else open_result(cube)
        report_compiling()
        from dimersweep.exploring.serving import Explorer

        try:
            explorer = Explorer(opened, port)
        except ParameterError as error:
            raise ParameterError(f"{cube}: {error}") from None
        typer.echo(f"{explorer.address} (Ctrl-C ends it)")
        if show:
            import webbrowser

            webbrowser.open(explorer.address)
        explorer.wait()


def _selected(cube: "xr.Dataset", text: str) -> "xr.Dataset":
    """Return `cube` at the value of an axis nearest to the value in `text`, such as f=15."""
    from dimersweep.cubes.findings import nearest

    name, _, value = text.partition("=")
    if name not in cube.dims:
        allowed = ", ".join(map(str, cube["mode"].dims if "mode" in cube else cube.dims))
        raise typer.BadParameter(f"--select {text}: {name or 'nothing'} is no axis of the cube ({allowed})")
    return nearest(cube, name, value)


def draw_marked(
    tell: Printer, cube: "xr.Dataset", picture: Path, kind: str | None = None, quantity: str | None = None
) -> None:
    """Draw `cube` to a file that may be replaced, marked with the checksum of the cube, and print its path."""
    from dimersweep.plots import write_picture

    marked = {"Keywords": PICTURE_MARK + cube.attrs.get("configuration_sha256", "none")}
    write_picture(cube.dimersweep.plot(kind, quantity=quantity), picture, force=True, metadata=marked)
    tell(f"picture: {picture}", picture=str(picture))


def show_written(tell: Printer, cube: "xr.Dataset", out: Path, picture: Path | None, *, force: bool) -> None:
    """Print a summary of a cube that was just written, and draw it; if drawing fails, warn, and let the command succeed."""
    print_cube(tell, cube)
    tell(f"cube: {out}", cube=str(out))
    if picture is None:
        return
    try:
        check_picture_of(cube.attrs["configuration_sha256"], picture, force=force)
        draw_marked(tell, cube, picture)
    except Exception as error:
        warnings.warn(f"{picture}: was not drawn ({error})", RuntimeWarning, stacklevel=2)


def check_kind(declared: "Declaration", study: "Study") -> None:
    """Refuse a declared kind of picture that does not fit the cube of `study`.

    Raises
    ------
    ParameterError
        If the kind does not fit the axes, or lacks what it draws.
    """
    from dimersweep.plots.checking import check

    if "plot" not in declared.model_fields_set:
        return
    sweep, kind = declared.sweep, declared.attrs["plot"]
    asked = {"search": declared.search, "paths": declared.paths, "strobes": sweep.strobes, "sustained": sweep.sustained}
    sizes = {name: values.size for name, values in study.grid.axes.items()}
    try:
        check(kind, sizes, {feature for feature, is_given in asked.items() if is_given})
    except ParameterError as error:
        raise ParameterError(f"plot.kind = {kind!r}: {error}; another kind, or --no-plot") from None


def check_picture_of(configuration_sha256: str, picture: Path, *, force: bool) -> None:
    """Refuse to replace a picture, unless it was drawn from a cube of this configuration.

    Such a picture can be drawn again from the new cube.

    Raises
    ------
    StoreError
        If there is another file, and not `force`.
    """
    from dimersweep.storage.outputs import check_output

    check_output(picture, force=True, name="picture", endings=None)  # first: reading a device might never end
    ours = _mark_in(picture) == PICTURE_MARK + configuration_sha256
    check_output(picture, force=force or ours, name="picture", endings=None)


def _mark_in(picture: Path) -> str | None:
    """Return the mark of a picture; None if there is no picture, or it has no mark."""
    from PIL import Image

    try:
        with Image.open(picture) as image:
            return image.info.get("Keywords")
    except OSError:  # no such file, or a file that is no picture
        return None


def print_cube(tell: Printer, cube: "xr.Dataset") -> None:
    """Print the tally of modes, or of the answers and runs of a search; for segments, the length of each row."""
    from dimersweep.cubes.cube import names
    from dimersweep.cubes.findings import drift_lengths, search_summary
    from dimersweep.storage.cubefiles import modes_in

    if "observer_error" in cube:  # an observer of a user's own may have failed
        errors = Counter(text for text in cube["observer_error"].values.ravel().tolist() if text)
        tell(
            *(f"status observer {count}: {text}" for text, count in errors.most_common()), observer_errors=dict(errors)
        )
    if "answer" in cube:
        answers = Counter(names(cube["answer"]).values.ravel().tolist())
        tell(search_summary(cube), answers=dict(answers), runs=int(cube["n_runs"].sum()))
        return
    modes = modes_in(cube)
    tell(", ".join(f"{mode} {count}" for mode, count in modes.items()), modes=modes)
    if "confidence" in cube:
        sure = dict(Counter(names(cube["confidence"]).values.ravel().tolist()).most_common())
        tell("modes that are " + ", ".join(f"{word} {count}" for word, count in sure.items()), confidence=sure)
    if cube.sizes.get("direction", 0) > 1:
        _print_loops(tell, cube)
    if cube.attrs.get("plot") != "segments" or "beta0" not in cube["mode"].dims or cube["mode"].squeeze().ndim > 2:
        return
    lengths = drift_lengths(cube)
    name, rows = str(lengths.dims[0]), []
    for at, length in zip(lengths[lengths.dims[0]].values.tolist(), lengths.values.tolist(), strict=True):
        tell(f"{parameter_shown(name, at)}: initial dip angles that drift make up {length:.4f} rad in all")
        rows.append({name: at, "length": length})
    tell(drift_lengths=rows)


def _print_loops(tell: Printer, cube: "xr.Dataset") -> None:
    """Print the ends of each loop, between which the ways up and down lead to different motions."""
    from dimersweep.studies.loops import loops

    found = loops(cube)
    axis, rows = found.attrs["parameter"], []
    for k in range(found.sizes["loop"]):
        loop = found.isel(loop=k)
        at = {str(name): loop[name].item() for name in loop.coords if name in PARAMETERS and found[name].ndim}
        where = ", ".join(parameter_shown(name, value) for name, value in at.items())
        ends = " to ".join(_end(loop, which) for which in ("low", "high"))
        tell(f"{where + ': ' if where else ''}up and down differ from {axis} = {ends}")
        rows.append(at | {name: loop[name].item() for name in ("low", "low_error", "high", "high_error")})
    tell(loops=rows, loops_along=axis)


def _end(loop: "xr.Dataset", which: str) -> str:
    """Return the `low` or `high` end of a loop as a text, such as 0.785 ± 0.005, or "beyond the axis".

    The number after ± is half the length of the step in which the end lies.
    """
    value = loop[which].item()
    return f"{value:.6g} ± {loop[f'{which}_error'].item():.2g}" if isfinite(value) else "beyond the axis"

"""Print the results of commands: lines for people, one JSON object for programs, or nothing."""

import sys
from collections.abc import Iterable, Sequence
from math import isnan
from shutil import get_terminal_size
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperCommand

from dimersweep.cli.interrupting import interruptible
from dimersweep.cli.options import OUTPUT, PARAMETER_OPTIONS, in_lines, option, options_of

UNBOUNDED = 10**6  # columns of a console that is wider than any table


class Printer:
    """The output of a command: lines as they come, or one JSON object at the end.

    Parameters
    ----------
    json, quiet : bool
        Options of the command. Errors and warnings go to stderr with both of them.
    """

    def __init__(self, json: bool, quiet: bool) -> None:
        self.json, self.quiet, self.values = json, quiet, dict[str, Any]()

    def __call__(self, *lines: str, **values: Any) -> None:
        """Print lines, or keep the same content as `values` for the JSON object."""
        for line in lines if self.shown else ():
            typer.echo(line)
        self.values |= values

    def report_compiling(self) -> None:
        """Print on stderr that the kernel is compiled, if it has to be."""
        from dimersweep.work.progress import report_compiling

        if not self.quiet:
            report_compiling()

    @property
    def shown(self) -> bool:
        """True if lines are printed."""
        return not (self.json or self.quiet)

    def rows(self, name: str, units: dict[str, str], rows: Iterable[tuple[Any, ...]]) -> None:
        """Print a table with columns named by `units`, in these units; in JSON each row is an object."""
        kept = [*rows]
        self.values[name] = [dict(zip(units, row, strict=True)) for row in kept]
        if self.shown:
            heads = [f"{head} [{unit}]" if unit else head for head, unit in units.items()]
            print_table(heads, [[_shown(cell) for cell in row] for row in kept])

    def end(self) -> None:
        """Print the JSON object, if it was asked for; null stands for NaN and infinity, which JSON lacks."""
        if self.json:
            from json import dumps, loads

            typer.echo(dumps(loads(dumps(self.values), parse_constant=lambda constant: None), indent=1))


def _shown(cell: Any) -> str:
    """Return the text of a cell: "" for NaN, 6 digits for other floats."""
    return str(cell) if not isinstance(cell, float) else "" if isnan(cell) else f"{cell:.6g}"


def print_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table with whole cells; if it is wider than the terminal, print a block of lines for each row."""
    from rich.console import Console
    from rich.table import Table

    # without a height rich would ignore the width, and take a simple terminal or a pipe for one of 80 columns
    console, table = Console(width=UNBOUNDED, height=1, markup=False, emoji=False), Table(*heads)
    rows = [*rows]
    for row in rows:
        table.add_row(*row)
    console.width = console.measure(table).maximum
    if not sys.stdout.isatty() or console.width <= get_terminal_size().columns:
        console.print(table)
        return
    for row in rows:
        for k, (head, cell) in enumerate(zip(heads, row, strict=False)):
            if cell:
                typer.echo(in_lines(f"{'  ' if k else ''}{head}: {cell}"))


class Plain:
    """Base of commands, and of the group of them, whose flags are shown without a type."""

    def get_params(self, context: Any) -> Any:
        """Return all options, without the type of flags."""
        params = super().get_params(context)  # type: ignore[misc]
        for each in params:
            each.metavar = "" if getattr(each, "is_flag", False) else each.metavar
        return params


def _of_output(
    json: Annotated[bool, option("Print JSON.", "--json", group=OUTPUT)] = False,
    quiet: Annotated[bool, option("Print nothing.", "--quiet", group=OUTPUT)] = False,
) -> None: ...


class Command(Plain, TyperCommand):
    """Command with its own options alone."""


class PrintingCommand(Command):
    """Command with the options --json and --quiet, whose function finds a `Printer` in its context.

    A signal ends it with one line.
    """

    shared: ClassVar = options_of(_of_output)

    def __init__(self, name: str | None, *, params: list[Any], **how: Any) -> None:
        super().__init__(name, params=[*params, *self.shared], **how)

    def invoke(self, context: Any) -> None:
        """Run the function of the command; ``context.obj`` has its `Printer` and the parameters that were typed."""
        given = {each.name: context.params.pop(each.name) for each in self.shared}
        tell = Printer(given.pop("json"), given.pop("quiet"))
        context.obj = tell, {name: value for name, value in given.items() if value is not None}
        with interruptible():
            super().invoke(context)
        tell.end()


class DimerCommand(PrintingCommand):
    """Command that takes the parameters of a dimer as options, too."""

    shared = PARAMETER_OPTIONS + PrintingCommand.shared

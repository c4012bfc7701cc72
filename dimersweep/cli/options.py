"""Options that several commands share, and the checking of their texts."""

import sys
from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path
from shutil import get_terminal_size
from textwrap import wrap
from typing import Annotated, Any

import typer

from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import WAVES
from dimersweep.symbols import ACCEPTED, BASE, HIGHER, INSTEAD, LEFT_OUT, PARAMETERS, START, value_shown

OUTPUT, RUN = "Output", "Run"  # groups of options, beside those of `_group_of`


def argument(name: str, meaning: str, words: Callable[[], Iterable[str]] | None = None) -> Any:
    """Return a positional argument of a command; shells complete it to one of `words`."""
    return typer.Argument(metavar=name, help=meaning, autocompletion=words and _completed(words))


def option(
    meaning: str, *names: str, group: str = RUN, words: Callable[[], Iterable[str]] | None = None, **how: Any
) -> Any:
    """Return an option of a command, by default named as its parameter; shells complete it to one of `words`."""
    return typer.Option(*names, help=meaning, rich_help_panel=group, autocompletion=words and _completed(words), **how)


def _completed(words: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a function that completes a text to those of `words` that begin with it."""
    return lambda incomplete: [word for word in words() if word.startswith(incomplete)]


def number_option(meaning: str, kind: type = float) -> Any:
    """Return an option that takes a number, or a whole number if `kind` is int."""
    word, metavar = ("whole number", "COUNT") if kind is int else ("number", "NUMBER")

    def read(text: Any) -> Any:
        try:
            return kind(text)
        except ValueError:
            raise typer.BadParameter(f"{text!r} is not a {word}") from None

    return option(meaning, parser=read, metavar=metavar)


Table = Annotated[Path | None, option("File to keep the result in (NetCDF).", group=OUTPUT)]
Drawn = Annotated[Path | None, option("Picture of it.", group=OUTPUT)]
Spin = Annotated[str | None, option("Axial spin of the orbit (rad/s, or 1000rpm).", metavar="NUMBER")]
Force = Annotated[bool, option("Replace files that exist.", "--force", group=OUTPUT)]
Workers = Annotated[int | None, number_option("Threads; one for each core by default.", int)]
Periods = Annotated[int | None, number_option("Forcing periods, in place of the declared ones.", int)]
Rtol = Annotated[float | None, number_option("Accuracy, in place of the declared one.")]
Accuracy = Annotated[float, number_option("Accuracy, 1e-13 to 1e-2.")]


def parted(text: str, count: int, also: tuple[str, ...] = ()) -> tuple[str, Any]:
    """Return the name and the `count` values in a text such as Gamma=0.8:1:0.05, or phi0=any.

    The name is a parameter, or one of `also`; others are refused (ParameterError).
    """
    name, _, values = text.partition("=")
    parts = values.split(":")
    if text == "phi0=any" and count == 2:
        return name, values
    if name not in (*PARAMETERS, *also) or len(parts) != count:
        forms = {
            2: "NAME=LOW:HIGH, such as beta0=1deg:89deg, or phi0=any",
            3: "NAME=START:STOP:STEP, such as Gamma=0.8:1:0.05",
        }
        raise ParameterError(f"{text!r}: must be {forms[count]}")
    return name, parts


def in_lines(text: str) -> str:
    """Return a text in lines of a terminal, broken at spaces only, since a terminal would break numbers."""
    if not sys.stdout or not sys.stdout.isatty():
        return text
    width = get_terminal_size().columns
    return "\n".join(wrap(text, width, break_long_words=False, break_on_hyphens=False))


def _by_default(name: str) -> str:
    """Return the default of a parameter as a text: a number, or the name of another parameter."""
    value = (BASE | LEFT_OUT)[name]
    return value if isinstance(value, str) else value_shown(name, value)


def _group_of(name: str) -> str:
    """Return the group of options in which a parameter is shown."""
    if name in (*START, "phi0"):
        return "Start"
    if name in ("Gamma", "f", "g", "A_z", "v_z") or name in chain.from_iterable(chain(*WAVES)):
        return "Plate"
    return "Imperfections" if name in LEFT_OUT else "Dimer"


def options_of(function: Callable[..., None]) -> list[Any]:
    """Return the options that Typer makes of the signature of a function."""
    alone = typer.Typer(add_completion=False)
    alone.command()(function)
    options: list[Any] = typer.main.get_command(alone).params
    return options


def _of_parameter(name: str) -> Any:
    """Return the option of a parameter of the model; its value stays a text, which `Parameters` reads with its unit."""
    quantity = ACCEPTED[name]
    either = quantity.units + {"rad": ", or 16deg", "m": ", or 2mm"}.get(quantity.units, "")
    units = "" if quantity.units == "1" else f" ({either})"
    meaning = f"{quantity.long_name}{units}" + ("" if name in INSTEAD else f"; {_by_default(name)} by default")
    how: dict[str, Any] = {"group": _group_of(name), "parser": str, "metavar": "NUMBER", "hidden": name in HIGHER}

    def typed(value: Annotated[Any, option(meaning, f"--{name}", **how)] = None) -> None: ...

    (made,) = options_of(typed)
    made.name = name
    return made


def _of_harmonics(
    harmonics: Annotated[
        Path | None, option("File of the plate's motion (TOML), in place of Gamma, phi0, Gamma_2, ...", group="Plate")
    ] = None,
) -> None: ...


# options of each command of a dimer: what `ACCEPTED` says of each parameter
PARAMETER_OPTIONS = [*map(_of_parameter, ACCEPTED), *options_of(_of_harmonics)]

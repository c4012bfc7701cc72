"""List what people build on: public names with their signatures, options of the command line, and what stands in files.

``python -m tests.checks.public > tests/data/public.txt`` writes the list; CONTRIBUTING says how a name is retired.
"""

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Unpack, get_args, get_origin, get_type_hints

import typer
import xarray as xr

import dimersweep
from dimersweep import cli, errors, fits, orbits, plots
from dimersweep.symbols import ACCEPTED

FORMER = Path(__file__).parents[1] / "data" / "1.0"
ROOMS = {"dimersweep": dimersweep, "orbits": orbits, "fits": fits, "plots": plots, "errors": errors}


def names() -> Iterator[str]:
    """Yield each public name with its signature, and those of the members of public classes."""
    for room, module in ROOMS.items():
        own = [name for name, each in vars(module).items() if getattr(each, "__module__", "") == module.__name__]
        listed = getattr(module, "__all__", own)
        for name in sorted(listed):
            yield from _described(f"{room}.{name}", getattr(module, name))


def _described(name: str, value: Any) -> Iterator[str]:
    """Yield a name with what can be called of it: its signature, or of a class each public member."""
    if not inspect.isclass(value):
        yield f"{name}{_signature(value)}"
        return
    yield f"class {name}{_signature(value)}"
    for member, what in sorted(inspect.getmembers_static(value)):
        if member.startswith("_") or hasattr(tuple, member) or hasattr(Exception, member):
            continue
        plain = getattr(what, "__func__", what)
        yield f"{name}.{member}{_signature(plain) if callable(plain) else ''}"


def _signature(value: Any) -> str:
    """Return the names and defaults of parameters, without types; "" of what is not called.

    Behind keywords whose names are a `TypedDict` stand these names.
    """
    if not callable(value):
        return ""
    try:
        signature = inspect.signature(value)
    except ValueError:  # of some built-in types
        return "(...)"
    bare = [each.replace(annotation=inspect.Parameter.empty) for each in signature.parameters.values()]
    shown = str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))
    return " ".join([shown, *keywords(value)])


def keywords(value: Any) -> list[str]:
    """Return the names of the keyword arguments that a function takes by a `TypedDict` (``**options: Unpack[...]``)."""
    kinds = [each.annotation for each in inspect.signature(value).parameters.values() if each.kind is each.VAR_KEYWORD]
    return [name for kind in kinds if get_origin(kind) is Unpack for name in get_type_hints(get_args(kind)[0])]


def options() -> Iterator[str]:
    """Yield each command with its arguments and options, and the defaults of these."""
    group: Any = typer.main.get_command(cli.app)
    for name, command in sorted(group.commands.items()):
        own = [each for each in command.params if each.name not in ACCEPTED]
        if len(own) < len(command.params):
            yield f"{name} --{' --'.join(each.name for each in command.params if each.name in ACCEPTED)}"
        for each in sorted(own, key=lambda each: each.name):
            words = " ".join([*each.opts, *each.secondary_opts])
            yield f"{name} {words}{'' if each.default is None else f' = {each.default}'}"


def variables() -> Iterator[str]:
    """Yield the variables of each kind of file, with dimensions, kind of number and unit, and its attributes."""
    for path in sorted(FORMER.glob("*.nc")):
        with xr.open_dataset(path, decode_cf=False) as data:
            for name, each in sorted(data.variables.items()):
                units = each.attrs.get("units", "")
                yield f"{path.stem}: {name}({', '.join(map(str, each.dims))}) {each.dtype.kind}{f' [{units}]' if units else ''}"
            yield from (f"{path.stem}: :{name}" for name in sorted(data.attrs))


def listing() -> str:
    """Return the whole list, in which each line stands for one promise."""
    return "\n".join([*names(), *options(), *variables(), ""])


if __name__ == "__main__":
    print(listing(), end="")

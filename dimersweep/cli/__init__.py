"""The command line: its commands, and how errors are shown. Heavy imports wait inside the commands."""

import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from dimersweep.cli.drawing import explore, plot
from dimersweep.cli.motion import lyapunov, power
from dimersweep.cli.printing import Command, DimerCommand, Plain, PrintingCommand
from dimersweep.cli.simulating import simulate
from dimersweep.cli.sweeping import merge, plan, presets, run, status, warm
from dimersweep.errors import UserError, unknown
from dimersweep.extensions import COMMAND_EXAMPLES, COMMANDS, is_installed, load

INTERRUPTED = 130  # exit code that shells expect after Ctrl-C: 128 + SIGINT (2)


class _Group(Plain, TyperGroup):
    """The group of all commands."""


app = typer.Typer(
    cls=_Group,
    help="Event-driven simulation of a 3D dimer on a vibrating plate.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

# commands: the class of each, by the options that it has beside its own; and examples that its help shows
EXAMPLES: dict[Callable[..., None], tuple[Any, ...]] = {
    simulate: (
        DimerCommand,
        "simulate --Gamma 0.9 --f 15 --beta0 16deg --periods 200 --plot run.png",
        "simulate --A_z 1mm --f 15 --r_1 5.1mm --json",
    ),
    run: (
        PrintingCommand,
        "run fig07",
        "run my.toml --out my.nc --workers 4 --certify",
        "run --from my.nc --out again.nc",
    ),
    merge: (PrintingCommand, "merge fig07.part-*.nc --out fig07.nc"),
    presets: (PrintingCommand, "presets", "presets fig07 > my.toml"),
    plan: (PrintingCommand, "plan fig08"),
    status: (PrintingCommand, "status fig08.nc"),
    plot: (PrintingCommand, "plot fig07.nc --select f=15", "plot fig14_16.nc --quantity radius"),
    explore: (Command, "explore", "explore fig08.nc"),
    lyapunov: (DimerCommand, "lyapunov --Gamma 3 --periods 300", "lyapunov --Gamma 3 --periods 300 --all --json"),
    power: (DimerCommand, "power --Gamma 0.9 --f 15", "power --A_z 1mm --out budget.nc"),
    warm: (PrintingCommand, "warm"),
}


def _all_commands() -> dict[Callable[..., None], tuple[Any, ...]]:
    """Return each command with its class and examples: those of the engine, and of the analysis where it is installed."""
    if not is_installed():
        return EXAMPLES
    examples = load(COMMAND_EXAMPLES, "commands")
    return EXAMPLES | {load(place, name): examples[name] for name, place in COMMANDS.items()}


for command, (kind, *examples) in _all_commands().items():
    shown = "\n\n".join(f"dimersweep {each}" for each in examples)
    app.command(cls=kind, epilog=f"Examples:\n\n{shown}")(command)


def _show_version(wanted: bool) -> None:
    if wanted:
        from dimersweep import __version__

        typer.echo(f"dimersweep {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _top(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Version.")] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _fail(message: str) -> None:
    """Print an error in one line, and exit with code 2."""
    # messages name an argument of Python, such as keep_tiles=True; here it is an option
    typed = re.sub(r"\b([a-z_]+)=True\b", lambda found: "--" + found[1].replace("_", "-"), message)
    print(f"dimersweep: error: {typed}", file=sys.stderr)
    sys.exit(2)


def _unknown_option(error: Any) -> str:
    """Return the message for an option that a command does not have, with similar options; "" for other errors."""
    if not (hasattr(error, "option_name") and hasattr(error, "possibilities")):
        return ""
    there = [option for each in error.ctx.command.get_params(error.ctx) for option in each.opts if option[:2] == "--"]
    return unknown(error.option_name, "option", there, f"{error.ctx.command_path} --help has all")


def _refused(error: OSError) -> str:
    """Return the message for a file that the system refuses; a file without a name is standard output."""
    if error.filename is None:
        with suppress(OSError, ValueError):  # Python flushes at its end, which would fail again
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    name = "what is printed" if error.filename is None else error.filename
    return f"{name}: {error.strerror or error}"


def _warn(message: Warning | str, *others: Any, **more: Any) -> None:
    print(f"dimersweep: warning: {message}", file=sys.stderr, flush=True)


def main() -> None:
    """Run the command line; an error that the user can mend is shown in one line, with exit code 2."""
    import warnings

    warnings.showwarning = _warn
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a stream that was closed or replaced is left alone
            stream.reconfigure(errors="backslashreplace")  # a terminal may not have all letters
    try:
        code = app(prog_name="dimersweep", standalone_mode=False)
    except UserError as error:
        _fail(str(error))
    except ImportError as error:
        _fail(f"cannot run with the packages and settings that there are ({error})")
    except OSError as error:
        _fail(_refused(error))
    except Exception as error:
        if not hasattr(error, "format_message"):  # marks a usage error, whose class moved between versions of typer
            raise
        _fail(_unknown_option(error) or " ".join(error.format_message().split()))
    if code == INTERRUPTED:  # Ctrl-C came before a command began
        print("dimersweep: interrupted: nothing was written", file=sys.stderr)
        os._exit(INTERRUPTED)  # threads may be inside compiled code, which Ctrl-C does not reach

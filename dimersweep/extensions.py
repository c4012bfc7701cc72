"""List what the analysis adds to the engine: commands, pictures, observers and maps, and where each is loaded from.

The engine imports nothing of `dimersweep.analysis`. It loads an entry of these tables when a user asks for it by name.
Where the analysis is not installed, its commands are absent, and any other entry is refused.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from dimersweep.errors import ParameterError

ANALYSIS = "dimersweep.analysis"

# command of the command line: its function
COMMANDS = {
    "borders": "commands.bordering:borders",
    "orbits": "commands.finding:orbits",
    "later": "commands.finding:later",
    "attractors": "commands.finding:attractors",
    "fit": "commands.measuring:fit",
    "waveform": "commands.measuring:waveform",
}
# class of each command, and examples that its help shows, by its name
COMMAND_EXAMPLES = "commands:ANALYSIS_EXAMPLES"
# variables by which tables of attractors, and of orbits, are known
ATTRACTORS, ORBITS = "attractor", "slow_multiplier"
# picture in `dimersweep.plots`, of a cube or of attractors: the function that draws it
CUBE_PICTURES = {"circles": "circles:circles", "attractors": "attractors.pictures:attractors"}
# variable by which a table is known: the function that draws the table; the last function draws all other tables
TABLE_PICTURES = {ATTRACTORS: CUBE_PICTURES["attractors"], "": "orbits.borders.pictures:draw_borders"}
# switch of `sweep`: the observer that it adds
OBSERVERS = {"sustained": "observers:Sustained"}
# code that the numbers of orbits pass, besides that of runs: it counts in the version of results with orbits
ORBITS_CODE = ("analysis/orbits", "analysis/observers.py")
# variable by which a table is known: its map in the explorer
MAPS = {ORBITS: "mapping:BorderMap"}


def is_installed() -> bool:
    """Return True if the package `dimersweep.analysis` is installed."""
    return find_spec(ANALYSIS) is not None


def load(place: str, name: str) -> Any:
    """Load the object at a place of the analysis, such as ``"circles:circles"`` (module:name).

    `name` is how a user calls it, for the message of an error.

    Raises
    ------
    ParameterError
        If the analysis is not installed.
    """
    if not is_installed():
        raise ParameterError(f"{name}: needs {ANALYSIS}, which is not installed")
    module, _, there = place.partition(":")
    return getattr(import_module(f"{ANALYSIS}.{module}"), there)

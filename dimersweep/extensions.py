"""List what the analysis adds to the engine: commands, pictures, observers and maps, and where each is loaded from.

The engine imports nothing of `dimersweep.analysis`. It loads what stands here when it is asked for, by name. Where that folder
is not installed, these commands are not there, and what else is asked for by name is refused.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from dimersweep.errors import ParameterError

ANALYSIS = "dimersweep.analysis"

# of each command of the command line, its function
COMMANDS = {
    "borders": "commands.bordering:borders",
    "orbits": "commands.finding:orbits",
    "later": "commands.finding:later",
    "attractors": "commands.finding:attractors",
    "fit": "commands.measuring:fit",
    "waveform": "commands.measuring:waveform",
}
# of each command, the examples that its help shows
EXAMPLES = "commands:EXAMPLES"
# of each kind of picture of a cube, the function that draws it
PICTURES = {"circles": "circles:circles", "attractors": "attractors.pictures:attractors"}
# of each kind of table, by a variable that marks it, the function that draws it; the last draws all others
TABLE_PICTURES = {"attractor": PICTURES["attractors"], "": "orbits.borders.pictures:draw_borders"}
# of each switch of `sweep`, the observer that it adds
OBSERVERS = {"sustained": "observers:Sustained"}
# of each kind of table, by a variable that marks it, its map in the explorer
MAPS = {"slow_multiplier": "mapping:BorderMap"}


def is_installed() -> bool:
    """Return whether the analysis is there."""
    return find_spec(ANALYSIS) is not None


def load(place: str, name: str) -> Any:
    """Load what stands at a place, such as ``"circles:circles"``, for what a user calls `name`.

    Raises
    ------
    ParameterError
        If the analysis is not installed.
    """
    if not is_installed():
        raise ParameterError(f"{name}: needs {ANALYSIS}, which is not installed")
    module, _, there = place.partition(":")
    return getattr(import_module(f"{ANALYSIS}.{module}"), there)

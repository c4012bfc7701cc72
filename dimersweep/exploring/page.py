"""The page with the moving dimer: what it is built of, and what it is answered when it asks for a run or a part of the map."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.exploring.mapping import map_of
from dimersweep.inputs import check_count
from dimersweep.parameters import check_name, completed
from dimersweep.plots.view import USUAL_SPEED, as_shown, filled, seen, stretch_of
from dimersweep.runs.simulating import simulate
from dimersweep.symbols import BASE, HIGHER, LEFT_OUT, PARAMETERS, symbol, units_of

SECONDS = 10.0  # at most, of a run that a page waits for
SETTINGS_SHOWN = {
    "periods": (200, "forcing periods at most: the run ends when it has settled"),
    "rtol": (1e-8, "accuracy"),
}
SHOWN_STRETCH = {"shown": "end", "stretch": "6"}  # what a page shows of a run, and so many forcing periods of it
SLIDERS = {  # least and greatest value and step, in the unit that is shown
    "Gamma": (0, 3, 0.01),
    "f": (5, 60, 0.1),
    "e": (0, 1, 0.01),
    "mu": (0, 1, 0.01),
    "mu_s": (0, 1, 0.01),
    "A_r": (2, 15, 0.1),
    "beta0": (-89, 89, 0.5),
    "xdot0": (-3, 3, 0.02),
}
CONTROLS = Path(__file__).with_name("explore.html")


def _field(name: str) -> dict[str, Any]:
    """What a page needs for the field of a parameter."""
    value = BASE.get(name, LEFT_OUT.get(name, ""))
    base = value if isinstance(value, str) else as_shown(name, value)
    told = {"name": name, "label": symbol(name), "unit": units_of(name), "says": PARAMETERS[name].long_name}
    shown = {"range": SLIDERS.get(name), "higher": name in HIGHER}
    return told | {"base": base if name in BASE else "", "usual": base} | shown


class LivePage:
    """A page of one dimer, and of a cube if there is one; it raises a `UserError` where what is asked for cannot be."""

    def __init__(self, cube: xr.Dataset | None = None) -> None:
        self.map = None if cube is None else map_of(cube)

    def html(self) -> str:
        """All of it, which asks for `run` and for parts of the map where it came from."""
        settings = [
            {"name": name, "label": name, "unit": "", "says": says, "base": f"{usual:g}", "usual": f"{usual:g}"}
            for name, (usual, says) in SETTINGS_SHOWN.items()
        ]
        fields = [_field(name) for name in dict.fromkeys((*SLIDERS, *PARAMETERS))]
        told = {
            "fields": [*fields, *settings],
            "stretch": SHOWN_STRETCH,
            "map": self.map and self.map.told(),
            "speed": USUAL_SPEED,
        }
        return filled(told, "dimersweep explore", CONTROLS.read_text(encoding="utf-8"))

    def run(self, asked: dict[str, str]) -> dict[str, Any]:
        """What a page draws of a run, see `seen`: of parameters and settings, or `at` a point of the cube in their place."""
        how: dict[str, Any] = SHOWN_STRETCH | asked
        shown, stretch = how.pop("shown"), check_count("stretch", _number(how.pop("stretch")))
        if shown not in ("start", "end"):
            raise ParameterError(f"shown = {shown}: must be start or end")
        at = how.pop("at", "")
        if at and self.map is not None:
            run, settings = self.map.run(at)
        else:
            settings = {name: _number(how.pop(name, str(usual))) for name, (usual, _) in SETTINGS_SHOWN.items()}
            settings["stop_when_settled"] = True
            for name in how:
                check_name(name)
            run = simulate(**how, **settings, max_seconds=SECONDS)
        told = seen(run, stretch_of(run, stretch, last=shown == "end"), settings)
        held = {name: f"{settings[name]:g}" for name in SETTINGS_SHOWN}
        return told | {
            "at": at,
            "settings": held,
            "place": {name: as_shown(name, value) for name, value in completed(run.parameters).items()},
        }


def _number(text: str) -> Any:
    """A text as the number that it is, else as it is, which will be refused."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text

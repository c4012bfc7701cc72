"""The page with the moving dimer: its text, and its answers to requests for a run or a part of the map."""

from pathlib import Path
from typing import Any

import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.exploring.mapping import map_of, one_of
from dimersweep.inputs import as_number, check_count, check_rtol, size_and_unit
from dimersweep.parameters import USUAL, broken, check_effect, check_name, completed, instead_of, spelt_out, updated
from dimersweep.plots.view import USUAL_SPEED, as_shown, filled, seen, stretch_of
from dimersweep.runs.simulating import simulate
from dimersweep.symbols import ACCEPTED, BASE, HIGHER, INSTEAD, LEFT_OUT, PARAMETERS, symbol, units_of

SECONDS = 10.0  # longest run that a page waits for
SETTINGS_SHOWN = {
    "periods": (200, "forcing periods at most: the run ends when it has settled"),
    "rtol": (1e-8, "accuracy"),
}
SHOWN_STRETCH = {"shown": "end", "stretch": "6"}  # part of a run that is shown at first: its last 6 forcing periods
# least value, greatest value and step of each slider, in the unit that is shown
SLIDERS = {
    "Gamma": (0, 3, 0.01),
    "A_z": (0, 4, 0.01),
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
    """Return the description of the field of a parameter, or of a quantity that may stand in its place."""
    value = BASE.get(name, LEFT_OUT.get(name, ""))
    usual = as_shown(name, value) if isinstance(value, float) else value and f"= {symbol(value)}"
    field = {"name": name, "label": symbol(name), "unit": units_of(name), "says": ACCEPTED[name].long_name}
    shown = {"group": INSTEAD.get(name, (name,))[0], "range": SLIDERS.get(name), "higher": name in HIGHER}
    return field | {"base": usual if name in BASE else "", "usual": usual} | shown


class LivePage:
    """A page for one dimer, with the map of a cube if there is one; raises a `UserError` for bad requests."""

    def __init__(self, cube: xr.Dataset | None = None) -> None:
        self.map = None if cube is None else map_of(cube)

    def html(self) -> str:
        """Return the page as HTML; it sends its requests to the address where it came from."""
        settings = [
            {"name": name, "label": name, "unit": "", "says": says, "base": f"{usual:g}", "usual": f"{usual:g}"}
            for name, (usual, says) in SETTINGS_SHOWN.items()
        ]
        fields = [_field(name) for name in dict.fromkeys((*SLIDERS, *INSTEAD, *PARAMETERS))]
        data = {
            "fields": [*fields, *settings],
            "stretch": SHOWN_STRETCH,
            "map": self.map and self.map.description(),
            "speed": USUAL_SPEED,
        }
        return filled(data, "dimersweep explore", CONTROLS.read_text(encoding="utf-8"))

    def run(self, asked: dict[str, str]) -> dict[str, Any]:
        """Return the drawing of a run, see `seen`: of the fields of the page, or of the point `at` of the cube.

        Raise a ParameterError with a line for each field at fault.
        """
        fields = SHOWN_STRETCH | asked
        at = fields.pop("at", "")
        if at and self.map is None:
            raise ParameterError(f"at = {at}: is a point of a map, and this page has none")
        given = _read({name: text for name, text in fields.items() if name in SHOWN_STRETCH or not at})
        shown, stretch = (given.pop(name) for name in SHOWN_STRETCH)
        if self.map is not None and at:
            run, settings = self.map.run(at)
        else:
            settings = {name: given.pop(name, usual) for name, (usual, _) in SETTINGS_SHOWN.items()}
            settings["stop_when_settled"] = True
            run = simulate(**given, **settings, max_seconds=SECONDS)
        drawing = seen(run, stretch_of(run, stretch, last=shown == "end"), settings)
        known = completed(run.parameters)
        return drawing | {
            "at": at,
            "settings": {name: f"{settings[name]:g}" for name in SETTINGS_SHOWN},
            "place": {name: as_shown(name, value) for name, value in (known | instead_of(known)).items()},
            "unusual": [*broken(run.parameters, USUAL)],
        }


def _read(fields: dict[str, str]) -> dict[str, Any]:
    """Return the values of the fields, checked one by one and together; raise a ParameterError with all faults."""
    values, wrong = {}, []
    for name, text in fields.items():
        try:
            values[name] = _value(name, text)
        except ParameterError as error:
            wrong.append(str(error))
    given = {name: value for name, value in values.items() if name in ACCEPTED}
    known = {name: value for name, value in BASE.items() if name not in fields}
    wrong += broken(updated(known, {name: value for name, value in given.items() if name in PARAMETERS}))
    try:
        check_effect(given)
        spelt_out(given, known)
    except ParameterError as error:
        wrong.append(str(error))
    if wrong:
        raise ParameterError("\n".join(dict.fromkeys(wrong)))
    return values


def _value(name: str, text: str) -> Any:
    """Return the value of a field; a number without a unit has the unit of the field."""
    if name == "shown":
        return one_of(name, text, ["start", "end"])
    if name == "rtol":
        return check_rtol(text)
    size, unit = size_and_unit(text)
    if name in ("periods", "stretch"):
        return check_count(name, int(size) if size is not None and size.is_integer() and not unit else text)
    if name not in INSTEAD:
        check_name(name)
    return as_number(name, text if unit or size is None else f"{text} {units_of(name)}", ACCEPTED[name].units)

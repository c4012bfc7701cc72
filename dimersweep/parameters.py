"""Check the parameters of a dimer, its plate and its start: their rules, for one set of values or for whole axes."""

import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import make_dataclass
from functools import lru_cache
from math import inf, nextafter, pi
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from dimersweep.errors import ParameterError, one_line, unknown
from dimersweep.inputs import as_number, number, read_toml
from dimersweep.kernel.model.layout import HARMONICS, N_ROW, ROW, WAVES, Dimer
from dimersweep.symbols import BASE, ENDS, HIGHER, INSTEAD, LEFT_OUT, PARAMETERS, STAND_INS


class Rule(NamedTuple):
    """Rule for one parameter: the range of its allowed values, in units of the parameter `other` if there is one.

    A rule for a parameter that each end may have of its own (`symbols.ENDS`) holds for the values of both ends.
    """

    name: str
    allowed: str
    least: float = -inf
    most: float = inf
    other: str = ""

    def holds(self, value: Any, unit: Any = 1.0) -> Any:
        """Return True where `value` obeys the rule; `unit` is the value of the other parameter.

        Both are scalars, or arrays of one shape.
        """
        above = value >= self.least * unit if self.least > -inf else value == value
        return above & (value <= self.most * unit) if self.most < inf else above


TINY = nextafter(0.0, 1.0)  # the least number above 0
ACUTE = nextafter(pi / 2, 0.0)  # the greatest angle below a right angle
# where one of these parameters is not zero, the motion depends on the heading
NOT_LEVEL = ("tilt", *(intensity for wave in WAVES[1:] for intensity, _ in wave))
NO_LESS = ">= {} = {} (stick friction is never below slip friction)"
RULES = (
    Rule("e", "in [0, 1]", 0, 1),
    Rule("Gamma", ">= 0", 0),
    *(
        Rule(intensity, f">= 0 (turn it by {phase})", 0)
        for wave in WAVES
        for intensity, phase in wave
        if phase != "phi0"
    ),
    Rule("f", "> 0", TINY),
    Rule("A_r", ">= 2 (below 2 the balls overlap)", 2),
    Rule("mu", ">= 0", 0),
    Rule("mu_s", NO_LESS, least=1, other="mu"),
    Rule("mu_h", NO_LESS, least=1, other="mu"),
    Rule("beta0", 'below pi/2 = 1.5708 in size (radians; degrees as "16 deg")', -ACUTE, ACUTE),
    Rule("r", "> 0", TINY),
    Rule("rho_b", "> 0", TINY),
    Rule("rho_r", ">= 0", 0),
    Rule("D_r", ">= 0", 0),
    Rule("D_r", "<= 2 r with {} = {} (the rod is thicker than the balls)", most=2, other="r"),
    Rule("g", "> 0", TINY),
    Rule("eta", ">= 1", 1),
    Rule("k_ratio", "> 0", TINY),
    Rule("tilt", 'in [0, pi/2) (radians; degrees as "2 deg")', 0, ACUTE),
    Rule("gap0", ">= 0 (the lower end would be below the plate)", 0),
)
# a value outside these ranges is most likely in another unit, such as millimetres or g/cm3: a warning says so
USUAL = (
    Rule("r", "at most 0.1 m", most=0.1),
    Rule("A_r", "at most 100", most=100),
    Rule("Gamma", "at most 50", most=50),
    Rule("f", "at most 10000 Hz", most=1e4),
    Rule("rho_b", "100 to 30000 kg m-3", 100, 3e4),
)


def check(columns: Mapping[str, Any], gaps: Collection[str] = ()) -> None:
    """Check every combination of the values in `columns`, and warn of unusual sizes.

    Parameters
    ----------
    columns : mapping of str to float or ndarray
        Values of each parameter, scalars or shape (n_k,), finite, SI units. No combination of values is laid out.
    gaps : collection of str
        Parameters that may break a rule that ties two of them; see `keeps_rules`.

    Raises
    ------
    ParameterError
        Naming the first value that breaks a rule, and what is allowed.
    """
    for line in broken(columns, gaps=gaps):
        raise ParameterError(line)
    for line in broken(columns, USUAL):
        warnings.warn(line, RuntimeWarning, stacklevel=2)


def broken(columns: Mapping[str, Any], rules: Iterable[Rule] = RULES, gaps: Collection[str] = ()) -> Iterator[str]:
    """Yield a line for each of the `rules` that a value in `columns` breaks.

    A rule that ties two parameters of `gaps` is not tested; see `check`.
    """
    for rule, name, other in _rules_for(columns, rules):
        if {name, other} <= set(gaps):
            continue
        given, unit = columns[name], columns[other] if other else 1.0
        # a value that obeys the rule beside the worst value of the other parameter obeys it beside all of them
        kept = rule.holds(given, (np.max if rule.most == inf else np.min)(unit) if other else unit)
        if np.all(kept):
            continue
        value, others = np.atleast_1d(given)[np.argmin(kept)], np.atleast_1d(unit)
        if rules is USUAL:
            yield f"{name} = {value:g}: {rule.allowed} is usual; is it in SI units?"
            continue
        allowed = rule.allowed.format(other, float(others[np.argmin(rule.holds(value, others))]))
        degrees = f" ({np.rad2deg(value):.6g} deg)" if PARAMETERS[name].units == "rad" else ""
        yield f"{name} = {float(value)}{degrees}: must be {allowed}"


def _rules_for(columns: Collection[str], rules: Iterable[Rule] = RULES) -> Iterator[tuple[Rule, str, str]]:
    """Yield each rule for parameters in `columns`, with the names there of its two parameters.

    A rule comes once for each end that has a value of its own. Harmonics that `columns` does not have are skipped.
    """
    for rule in rules:
        if rule.name in HIGHER and rule.name not in columns:
            continue
        both = [tuple(_at_end(k, name, columns) for name in (rule.name, rule.other)) for k in (0, 1)]
        for name, other in dict.fromkeys(both):
            if name in columns and (other in columns or not other):
                yield rule, name, other


def _at_end(k: int, name: str, columns: Collection[str]) -> str:
    """Return the name in `columns` that gives a parameter at p1 (k = 0) or p2 (k = 1): of that end, or of both."""
    own = ENDS[name][k] if name in ENDS else name
    return own if own in columns else name


def keeps_rules(columns: Mapping[str, Any]) -> Any:
    """Return True where points keep all rules that tie two parameters; scalars, or columns of one shape (n,)."""
    kept: Any = True
    for rule, name, other in _rules_for(columns):
        if other:
            kept = kept & rule.holds(columns[name], columns[other])
    return kept


def bounds(name: str, values: Mapping[str, float]) -> tuple[float, float]:
    """Return the least and the greatest allowed value of a parameter, where the other parameters are `values`."""
    low, high = -inf, inf
    for rule, one, other in _rules_for({**values, name: value_of(name, values)}):
        if name == one:
            unit = values[other] if other else 1.0
            low = max(low, rule.least * unit) if rule.least > -inf else low
            high = min(high, rule.most * unit) if rule.most < inf else high
        elif name == other and rule.most < inf:
            low = max(low, values[one] / rule.most)
        elif name == other:
            high = min(high, values[one] / rule.least)
    return low, high


def without_effect(names: Collection[str]) -> set[str]:
    """Return the parameters without effect where `names` are given: X, where both X_1 and X_2 are given."""
    return {name for name, ends in ENDS.items() if set(ends) <= set(names)}


def check_effect(names: Iterable[str]) -> None:
    """Refuse parameters if one of them has no effect beside the others.

    Raises
    ------
    ParameterError
    """
    names = set(names)
    for name in without_effect(names) & names:
        one, two = ENDS[name]
        raise ParameterError(f"{name}: has no effect beside {one} and {two}; leave one of the three out")


def updated(known: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the `known` parameters with those `given` in their place.

    X takes the place of X_1 and X_2, and X_1 and X_2 together that of X.

    Raises
    ------
    ParameterError
        If `spelt_out` refuses what is given.
    """
    given = spelt_out(given, known)
    replaced = {end for name in given for end in ENDS.get(name, ())}
    values = {name: value for name, value in known.items() if name not in replaced} | dict(given)
    idle = without_effect(values) - set(given)
    return {name: value for name, value in values.items() if name not in idle}


def spelt_out(given: Mapping[str, Any], known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return parameters as given, with the parameters that `harmonics` and other stand-ins give in place of these.

    Stand-ins are the quantities of `symbols.INSTEAD`: l, A_z and v_z.

    Parameters
    ----------
    given : mapping
    known : mapping, optional
        Values that hold for parameters that are not given, in place of the base case; None for those that vary.

    Raises
    ------
    ParameterError
        If a parameter is given twice, `harmonics` has another form, or a value is not allowed.
    """
    values = {name: value for name, value in given.items() if name not in STAND_INS}
    if given.get("harmonics") is not None:
        values |= _spelt_harmonics(given["harmonics"], {*given})
    for name, (parameter, quantity) in INSTEAD.items():
        if given.get(name) is None:
            continue
        if parameter in values:
            by = [each for each in (parameter, *STAND_INS) if each in given and each != name]
            raise ParameterError(f"{name}: given together with {by[0]}; leave one of the two out")
        size, others = as_number(name, given[name], quantity.units), BASE | dict(known or {}) | values
        needed = {each: others[each] for each in (("r", *ENDS["r"]) if name == "l" else ("f", "g")) if each in others}
        for each, value in needed.items():
            if value is None:
                raise ParameterError(f"{name}: takes one {each}, which varies here; give {parameter}")
            needed[each] = number(each, value)
        check(needed)
        if name == "l":
            radii = sum(value_of(each, needed) for each in ENDS["r"])
            if size < radii:
                raise ParameterError(f"l = {size}: must be >= r_1 + r_2 = {radii:.6g} (below it the balls overlap)")
            values[parameter] = 1 + size / radii
        else:
            omega = 2 * pi * needed["f"]
            values[parameter] = size * omega * (omega if name == "A_z" else 1.0) / needed["g"]
            if size < 0:
                raise ParameterError(f"{name} = {size}: must be >= 0")
    return values


def instead_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the quantities that may be given in place of parameters; the inverse of `spelt_out`."""
    omega = 2 * pi * values["f"]
    v_z = values["Gamma"] * values["g"] / omega
    return {"A_z": v_z / omega, "v_z": v_z, "l": (values["A_r"] - 1) * (values["r_1"] + values["r_2"])}


def _spelt_harmonics(given: Any, others: Collection[str]) -> dict[str, Any]:
    """Return the parameters that `harmonics` stands for: a mapping of axes, a waveform, or a file of one.

    `others` has the names of all parameters that are given with it.
    """
    waves = dict(zip(("z", "x", "y"), WAVES, strict=True))
    if isinstance(given, str | PathLike):
        path = Path(given)
        if path.suffix != ".toml" and path.is_file():
            how = f"dimersweep waveform {path} --out plate.toml"
            raise ParameterError(f"harmonics = {path}: must be a .toml file; of a record, `{how}` makes one")
        given = read_toml(path)
    harmonics = getattr(given, "harmonics", given)
    if not isinstance(harmonics, Mapping) or not harmonics or not {*harmonics} <= {*waves, "f"}:
        raise ParameterError(
            f"harmonics = {one_line(harmonics)}: must be a mapping of axes z, x, y to harmonics, or a waveform"
        )
    values: dict[str, Any] = {"f": harmonics["f"]} if "f" in harmonics else {}
    for axis in harmonics.keys() & waves.keys():
        values |= {intensity: 0.0 for intensity, _ in waves[axis]}
        if not isinstance(harmonics[axis], Mapping):
            raise ParameterError(
                f"harmonics.{axis} = {one_line(harmonics[axis])}: must be orders and (intensity, phase)"
            )
        for order, pair in harmonics[axis].items():
            if str(order) not in map(str, range(1, HARMONICS + 1)):
                raise ParameterError(f"harmonics.{axis}.{one_line(order)}: must be 1 to {HARMONICS}")
            if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
                raise ParameterError(f"harmonics.{axis}.{order} = {one_line(pair)}: must be an intensity and a phase")
            values |= dict(zip(waves[axis][int(order) - 1], pair, strict=True))
    for name in values.keys() & {*others}:
        raise ParameterError(f"{name}: given together with harmonics; leave one of the two out")
    return values


def moved_on(plate: Mapping[str, Any], by: Any) -> dict[str, Any]:
    """Return parameters, numbers or columns, whose plate starts later by the angle `by` of its phase [rad].

    The phase of its harmonic k along the normal grows by k times that angle. The phases along the plate count from the
    phase along the normal, so they stay.
    """
    moved = {
        phase: plate.get(phase, 0.0) + k * by
        for k, (intensity, phase) in enumerate(WAVES[0], start=1)
        if k == 1 or intensity in plate
    }
    return {**plate, **moved}


def value_of(name: str, columns: Mapping[str, Any]) -> Any:
    """Return the value or values of a parameter from `columns`.

    A parameter that is left out has its value of `symbols.LEFT_OUT`; None if that depends on others that are not there.
    """
    source = _source(name, columns)
    if not isinstance(source, str) or source in columns:
        return columns[source] if isinstance(source, str) else source
    r_1, r_2 = value_of("r_1", columns), value_of("r_2", columns)
    return None if r_1 is None or r_2 is None else np.sqrt(np.divide(r_2, r_1))


def _source(name: str, given: Collection[str]) -> str | float | None:
    """Return where the value of a parameter comes from: a parameter in `given`, "k_ratio", a number, or None.

    "k_ratio" stands for the ratio of stiffnesses that follows from both radii.
    """
    if name in given or name == "k_ratio":
        return name
    both = next((both for both, ends in ENDS.items() if name in ends and both in given), None)
    value = LEFT_OUT.get(name) if both is None else both
    return _source(value, given) if isinstance(value, str) else value


@lru_cache
def _sources(given: tuple[str, ...]) -> list[tuple[int, str | float | None]]:
    """Return the slots of a kernel row with the source of each (`_source`) if the parameters `given` are given.

    Slots of the value 0 are left out: a row is zero before it is filled.
    """
    known = [(slot, _source(name, given)) for slot, name in enumerate(ROW) if name in given or name not in HIGHER]
    return [(slot, source) for slot, source in known if source != 0.0]


def slots_of(name: str, given: Iterable[str]) -> list[int]:
    """Return the slots of a kernel row that hold the value of the parameter `name`, one of those `given`.

    There are none if other slots depend on it, as the ratio of stiffnesses does on the radii.
    """
    sources = _sources(tuple(given))
    tied = any(source == "k_ratio" for _, source in sources) and name in ("r", *ENDS["r"]) and "k_ratio" not in given
    return [] if tied else [slot for slot, source in sources if source == name]


def completed(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return `columns`, and after them each other parameter that has a value beside them.

    Harmonics that hardly any plate has (`symbols.HIGHER`) are not added.
    """
    others = {name: value_of(name, columns) for name in PARAMETERS if name not in columns and name not in HIGHER}
    return dict(columns) | {name: value for name, value in others.items() if value is not None}


def reduced(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return `columns` without the parameters that change nothing: without them the kernel row is the same.

    It is the inverse of `completed`.
    """
    kept, row = dict(columns), {slot: value_of(slot, columns) for slot in ROW}
    for name in (*LEFT_OUT, *ENDS):
        if name in kept:
            rest = {other: value for other, value in kept.items() if other != name}
            others = {slot: value_of(slot, rest) for slot in ROW}
            if all(_same(row[slot], others[slot]) for slot in ROW):
                kept, row = rest, others  # the same objects are not compared again
    return kept


def _same(one: Any, other: Any) -> bool:
    """Return True if two values or columns are equal; None equals None alone."""
    return one is other or (one is not None and other is not None and bool(np.all(one == other)))


def check_level(values: Mapping[str, float], wanted: str, instead: str = "") -> None:
    """Refuse a plate on which the motion depends on the heading; `wanted` names the results that leave it out.

    `instead` ends the message.

    Raises
    ------
    ParameterError
    """
    for name in NOT_LEVEL:
        if value := values.get(name):
            raise ParameterError(f"{name} = {value:g}: must be 0 for {wanted}, which leave the heading out{instead}")


def check_name(name: str) -> None:
    """Refuse a name that is no parameter of the model.

    Raises
    ------
    ParameterError
        Naming the parameters that there are.
    """
    if name in INSTEAD:
        parameter, quantity = INSTEAD[name]
        raise ParameterError(f"{name}: is for single runs and fixed values ({quantity.long_name}); give {parameter}")
    if name == "harmonics":
        raise ParameterError("harmonics: are for single runs and fixed values; give Gamma, Gamma_2, phi_2 and so on")
    if name not in PARAMETERS:
        shown = [each for each in PARAMETERS if each not in HIGHER]
        raise ParameterError(unknown(name, "parameter", [*shown, "Gamma_3 to phi_y_16"]))


def check_names(names: Iterable[str]) -> None:
    """Refuse names that are neither parameters of the model nor stand in for some (`symbols.STAND_INS`).

    Raises
    ------
    ParameterError
    """
    for name in names:
        if name not in STAND_INS:
            check_name(name)


def fill_rows(columns: Mapping[str, Any], n: int) -> np.ndarray:
    """Fill kernel rows from columns of checked parameters.

    Parameters
    ----------
    columns : mapping of str to float or ndarray
        Every parameter; those of `symbols.LEFT_OUT` may be missing. Scalars or shape (n,), SI units.
    n : int
        Number of points.

    Returns
    -------
    ndarray, shape (n, N_ROW), float64
        One row a point, in the order of ``kernel.layout.ROW``.
    """
    rows = np.zeros((n, N_ROW))
    for slot, source in _sources(tuple(columns)):
        rows[:, slot] = value_of(source, columns) if isinstance(source, str) else source
    return rows


def dimer_from(values: Mapping[str, float]) -> Dimer:
    """Return the kernel's dimer of checked parameters; those of `symbols.LEFT_OUT` may be missing."""
    from dimersweep.kernel.model.body import dimer_of

    return dimer_of(fill_rows(values, 1)[0])


Value = float | str | None  # a number in the SI unit, or a text with a unit such as "16 deg"


# parameters of the model as keyword arguments; what stands in for some of them; and higher harmonics of the plate
ParameterKeywords = TypedDict("ParameterKeywords", {  # noqa: UP013 - a class would take a line for each name
    "e": Value, "Gamma": Value, "f": Value, "A_r": Value, "mu": Value, "mu_s": Value, "beta0": Value,
    "xdot0": Value, "phi0": Value, "r": Value, "rho_b": Value, "rho_r": Value, "D_r": Value, "g": Value,
    "e_1": Value, "e_2": Value, "r_1": Value, "r_2": Value, "rho_b_1": Value, "rho_b_2": Value, "mu_1": Value,
    "mu_2": Value, "mu_s_1": Value, "mu_s_2": Value, "Gamma_2": Value, "phi_2": Value, "mu_h": Value,
    "mu_h_1": Value, "mu_h_2": Value, "eta": Value, "k_ratio": Value, "tilt": Value, "azimuth": Value,
    "Gamma_x": Value, "phi_x": Value, "Gamma_y": Value, "phi_y": Value, "theta0": Value, "ydot0": Value,
    "betadot0": Value, "thetadot0": Value, "gammadot0": Value, "gap0": Value,
    "l": Value, "A_z": Value, "v_z": Value, "harmonics": Any,
    "Gamma_3": Value, "phi_3": Value, "Gamma_4": Value, "phi_4": Value, "Gamma_5": Value, "phi_5": Value,
    "Gamma_6": Value, "phi_6": Value, "Gamma_7": Value, "phi_7": Value, "Gamma_8": Value, "phi_8": Value,
    "Gamma_9": Value, "phi_9": Value, "Gamma_10": Value, "phi_10": Value, "Gamma_11": Value, "phi_11": Value,
    "Gamma_12": Value, "phi_12": Value, "Gamma_13": Value, "phi_13": Value, "Gamma_14": Value, "phi_14": Value,
    "Gamma_15": Value, "phi_15": Value, "Gamma_16": Value, "phi_16": Value, "Gamma_x_2": Value, "phi_x_2": Value,
    "Gamma_x_3": Value, "phi_x_3": Value, "Gamma_x_4": Value, "phi_x_4": Value, "Gamma_x_5": Value,
    "phi_x_5": Value, "Gamma_x_6": Value, "phi_x_6": Value, "Gamma_x_7": Value, "phi_x_7": Value,
    "Gamma_x_8": Value, "phi_x_8": Value, "Gamma_x_9": Value, "phi_x_9": Value, "Gamma_x_10": Value,
    "phi_x_10": Value, "Gamma_x_11": Value, "phi_x_11": Value, "Gamma_x_12": Value, "phi_x_12": Value,
    "Gamma_x_13": Value, "phi_x_13": Value, "Gamma_x_14": Value, "phi_x_14": Value, "Gamma_x_15": Value,
    "phi_x_15": Value, "Gamma_x_16": Value, "phi_x_16": Value, "Gamma_y_2": Value, "phi_y_2": Value,
    "Gamma_y_3": Value, "phi_y_3": Value, "Gamma_y_4": Value, "phi_y_4": Value, "Gamma_y_5": Value,
    "phi_y_5": Value, "Gamma_y_6": Value, "phi_y_6": Value, "Gamma_y_7": Value, "phi_y_7": Value,
    "Gamma_y_8": Value, "phi_y_8": Value, "Gamma_y_9": Value, "phi_y_9": Value, "Gamma_y_10": Value,
    "phi_y_10": Value, "Gamma_y_11": Value, "phi_y_11": Value, "Gamma_y_12": Value, "phi_y_12": Value,
    "Gamma_y_13": Value, "phi_y_13": Value, "Gamma_y_14": Value, "phi_y_14": Value, "Gamma_y_15": Value,
    "phi_y_15": Value, "Gamma_y_16": Value, "phi_y_16": Value,
}, total=False)  # fmt: skip


class _BaseCase(float):
    """Value of the base case, for a parameter that was not given."""


def _left_out(name: str) -> float | None:
    """Return the value of a field that is not given: a number, or None where other parameters give it."""
    value = LEFT_OUT.get(name)
    return _BaseCase(BASE[name]) if name in BASE else None if isinstance(value, str) else value


_FIELDS = [(name, "float | None", _left_out(name)) for name in PARAMETERS]
_Fields: Any = make_dataclass("_Fields", _FIELDS, frozen=True, kw_only=True)


class Parameters(_Fields):
    """One dimer, its plate and its start, checked; the defaults are the paper's base case (Sect. 3).

    Parameters
    ----------
    e, e_1, e_2 : float
        Energetic coefficients of restitution [1], in [0, 1]: `e` of both ends, 0.6 by default; `e_1`, `e_2`, where
        given, of end p1, p2. All three together are refused, and `e` is None where `e_1` and `e_2` are given. The same
        holds for `r`, `rho_b`, `mu`, `mu_s`, `mu_h`.
    Gamma, f, phi0 : float
        Vibration intensity A_z omega^2/g [1], frequency [Hz] and phase at the start [rad] of the plate; 0.9, 15 and 0
        by default.
    Gamma_k, phi_k : float
        Intensity A_k (k omega)^2/g [1] of the plate's harmonic A_k sin(k omega t + phi_k), and its phase [rad]; k is 2
        to 16.
    A_z, v_z : float, optional
        Amplitude [m] or greatest velocity [m s-1] of A_z sin(omega t + phi0), in place of `Gamma`.
    harmonics : mapping, Waveform or path-like, optional
        The plate's motion along each axis, such as
        ``{"z": {1: (Gamma, phi0), 2: (Gamma_2, phi_2), ...}, "x": {1: (Gamma_x, phi_x)}}``.
        An axis that is given has no other harmonics. A `Waveform`, or a file of one, gives `f`, too.
    A_r, r, D_r : float
        Aspect ratio (l + r_1 + r_2)/(r_1 + r_2) [1], at least 2; ball radius and rod diameter [m]. By default 6, 0.005
        and 0.004.
    l : float, optional
        Distance between the centres of the balls [m], in place of `A_r`.
    mu, mu_s, mu_h : float
        Slip and stick friction coefficients [1], 0.2 and 0.4 by default. `mu_h` is the stick friction of a lasting
        contact, None for `mu_s`. If it is given, `mu_s` counts inside impacts only.
    beta0, xdot0 : float
        Initial dip angle [rad], below pi/2 in size, and velocity of ball 1 along X in the room [m s-1]; "16 deg" and 1
        by default. Level is at sin(beta) = (r_2 - r_1)/l: a smaller dip angle puts p2 on the plate.
    theta0 : float
        Initial heading [rad], the angle of the axis from Y.
    ydot0, betadot0, thetadot0, gammadot0 : float
        Initial velocity of ball 1 along Y in the room [m s-1], and rates of dip, precession and spinning angle, each
        [rad s-1]. With `xdot0` they are the first derivatives of the paper's coordinates. The derivative of z1, the
        height of ball 1, is zero.
    gap0 : float
        Initial height of the lower end's contact point over the plate [m], not negative.
    eta, k_ratio : float
        Exponent of the contacts in an impact, F = k X^eta [1], 3/2 for Hertz's law; k_2/k_1, None for sqrt(r_2/r_1).
    tilt, azimuth : float
        Angle of the plate from level, and of the direction in which it falls from its axis X [rad].
    Gamma_x, phi_x, Gamma_y, phi_y, Gamma_x_k, phi_x_k, Gamma_y_k, phi_y_k : float
        Intensities of a vibration along the plate's axes [1], and its phases before that along the normal [rad]; of its
        harmonics sin(k (omega t + phi0) + phi_x_k).
    rho_b, rho_r : float
        Densities of balls and rod [kg m-3], 7850 and 1180 by default; the rod may be without mass.
    g : float
        Gravity [m s-2], 9.81 by default. All parameters without a number here are 0 by default.

    Raises
    ------
    ParameterError
        On construction, for the first value that is not allowed.

    Examples
    --------
    >>> from dimersweep import Parameters
    >>> dimer = Parameters(Gamma=1.1, beta0="20 deg")
    >>> round(dimer.beta0, 4), dimer.A_r
    (0.3491, 6.0)
    """

    def __init__(self, **given: Unpack[ParameterKeywords]) -> None:
        super().__init__(**spelt_out(given))
        values = self._values()
        known = {name for name, value in values.items() if value is not None}
        check_effect(name for name in known if not isinstance(values[name], _BaseCase))
        unused = without_effect(known)
        for name, value in values.items():
            needed = name not in unused and (value is not None or _left_out(name) is not None)
            object.__setattr__(self, name, number(name, value) if needed else None)  # frozen from here on
        check(self.given())

    def given(self) -> dict[str, float]:
        """Return the parameters that have a value of their own.

        Missing are optional parameters (`symbols.LEFT_OUT`) that are left out or have their default. X is missing, too,
        where X_1 and X_2 are given.
        """
        values = self._values()
        return {name: value for name, value in values.items() if value is not None and value != LEFT_OUT.get(name)}

    def _values(self) -> dict[str, Any]:
        """Return the values of all fields by name, without harmonics that were not given."""
        return {name: value for name, value in vars(self).items() if name not in HIGHER or value is not LEFT_OUT[name]}

    def row(self) -> np.ndarray:
        """Return the kernel's row, shape (N_ROW,), float64, in the order of ``kernel.layout.ROW``."""
        return fill_rows(self.given(), 1)[0]

"""Words of the package: every parameter and every quantity of its results, with its unit and its meaning."""

from collections.abc import Collection, Mapping
from math import degrees, inf, isclose, pi
from typing import Literal, get_args

from dimersweep.kernel.model.layout import (
    CODE_COLUMNS,
    N_ORBIT,
    ORBIT_COLUMNS,
    OUT,
    RUN_COLUMNS,
    START_ROW,
    WAVES,
    Quantity,
)

# the paper's base case (Sect. 3)
BASE = {
    "e": 0.6,
    "Gamma": 0.9,
    "f": 15.0,
    "A_r": 6.0,
    "mu": 0.2,
    "mu_s": 0.4,
    "beta0": 4 * pi / 45,
    "xdot0": 1.0,
    "phi0": 0.0,
    "r": 5e-3,
    "rho_b": 7850.0,
    "rho_r": 1180.0,
    "D_r": 4e-3,
    "g": 9.81,
}


def _of_ends(name: str, units: str, meaning: str) -> dict[str, Quantity]:
    """Return one quantity for each end: in `name` and `meaning`, {} becomes the number of the end."""
    return {name.format(end): Quantity(units, meaning.format(end)) for end in (1, 2)}


PARAMETERS = {
    "e": Quantity("1", "energetic coefficient of restitution of both ends"),
    "Gamma": Quantity("1", "vibration intensity A_z omega^2 / g"),
    "f": Quantity("Hz", "vibration frequency"),
    "A_r": Quantity(
        "1", "aspect ratio (l + r_1 + r_2) / (r_1 + r_2), l being the distance between the centres of the balls"
    ),
    "mu": Quantity("1", "coefficient of slip friction"),
    "mu_s": Quantity("1", "coefficient of stick friction (inside impacts only, where mu_h is given)"),
    "beta0": Quantity("rad", "initial dip angle"),
    "xdot0": Quantity("m s-1", "initial velocity of ball 1 along X"),
    "phi0": Quantity("rad", "phase of the plate at the start"),
    "r": Quantity("m", "radius of the balls"),
    "rho_b": Quantity("kg m-3", "density of the balls"),
    "rho_r": Quantity("kg m-3", "density of the rod"),
    "D_r": Quantity("m", "diameter of the rod"),
    "g": Quantity("m s-2", "gravity"),
    **_of_ends("e_{}", "1", "energetic coefficient of restitution of end p{}"),
    **_of_ends("r_{}", "m", "radius of ball p{}"),
    **_of_ends("rho_b_{}", "kg m-3", "density of ball p{}"),
    **_of_ends("mu_{}", "1", "coefficient of slip friction of end p{}"),
    **_of_ends("mu_s_{}", "1", "coefficient of stick friction of end p{}"),
    "Gamma_2": Quantity("1", "intensity of the plate's second harmonic, A_2 (2 omega)^2 / g"),
    "phi_2": Quantity("rad", "phase of the plate's second harmonic at the start"),
    "mu_h": Quantity("1", "coefficient of stick friction of a lasting contact"),
    **_of_ends("mu_h_{}", "1", "coefficient of stick friction of a lasting contact of end p{}"),
    "eta": Quantity("1", "exponent of the contact in impacts, F = k X^eta"),
    "k_ratio": Quantity("1", "stiffness of the contact of p2 over that of p1 in impacts, k_2 / k_1"),
    "tilt": Quantity("rad", "angle of the plate from level"),
    "azimuth": Quantity("rad", "angle from the plate's axis X of the direction in which the plate falls"),
    "Gamma_x": Quantity("1", "vibration intensity along the plate's axis X, A_x omega^2 / g"),
    "phi_x": Quantity("rad", "phase of the vibration along X before the one along the normal"),
    "Gamma_y": Quantity("1", "vibration intensity along the plate's axis Y, A_y omega^2 / g"),
    "phi_y": Quantity("rad", "phase of the vibration along Y before the one along the normal"),
    "theta0": Quantity("rad", "initial heading: angle of the axis from the plate's axis Y"),
    "ydot0": Quantity("m s-1", "initial velocity of ball 1 along Y"),
    "betadot0": Quantity("rad s-1", "initial rate of the dip angle"),
    "thetadot0": Quantity("rad s-1", "initial rate of the precession angle"),
    "gammadot0": Quantity("rad s-1", "initial rate of the spinning angle"),
    "gap0": Quantity("m", "initial height of the lower end over the plate"),
}
# harmonics of the plate beyond those above, which few runs have: they are not shown where they are zero
HIGHER = frozenset(name for wave in WAVES for harmonic in wave for name in harmonic if name not in PARAMETERS)
for _wave, _words in zip(WAVES, ("its normal", "its axis X", "its axis Y"), strict=True):
    for _k, (_intensity, _phase) in enumerate(_wave, start=1):
        _said = f"harmonic {_k} of the plate's motion along {_words}"
        PARAMETERS.setdefault(
            _intensity, Quantity("1", f"intensity of {_said}, its amplitude times ({_k} omega)^2 / g")
        )
        PARAMETERS.setdefault(_phase, Quantity("rad", f"phase of {_said}"))
# parameters that may differ from end to end: X is the value of both ends, X_1 and X_2, where given, of p1 and p2
ENDS = {name: (f"{name}_1", f"{name}_2") for name in PARAMETERS if f"{name}_1" in PARAMETERS}
# parameters of the start but for the plate's phase: a run that starts from a given state takes none of them
START = START_ROW
# settings of the run of a point of a cube
SETTINGS = {
    "periods": Quantity("1", "forcing periods that the run was given", 1),
    "max_periods": Quantity(
        "1", "forcing periods up to which it was made anew, twice as long, while it had not settled", 1
    ),
    "rtol": Quantity("1", "accuracy of the run"),
    "stop_when_settled": Quantity(
        "1", "whether the run ended as soon as its motion had settled: 1 if so, else 0", 0, 1
    ),
    "kernel": Quantity("1", "version of the kernel, as a number"),
    # only in cubes whose state was carried
    "line": Quantity("1", "checksum of the values along which a state was carried to the run"),
}
# quantities that may be given in place of a parameter: the parameter, and the unit and meaning of the quantity
INSTEAD = {
    "l": ("A_r", Quantity("m", "distance between the centres of the balls, in place of A_r")),
    "A_z": ("Gamma", Quantity("m", "amplitude of the plate, in place of Gamma")),
    "v_z": ("Gamma", Quantity("m s-1", "greatest velocity of the plate, in place of Gamma")),
}
ACCEPTED = PARAMETERS | {name: quantity for name, (_, quantity) in INSTEAD.items()}
STAND_INS = (*INSTEAD, "harmonics")  # names of everything that may be given in place of parameters
# parameters that may be left out: the parameter whose value they have then, or a number
LEFT_OUT: dict[str, str | float] = {
    **{f"{name}_{end}": name for name in ("e", "r", "rho_b", "mu", "mu_s") for end in (1, 2)},
    "mu_h": "mu_s",
    "mu_h_1": "mu_s_1",  # unless mu_h is given: X comes before LEFT_OUT for every X_1
    "mu_h_2": "mu_s_2",
    "eta": 1.5,  # Hertz's law; its stiffness is proportional to the root of the radius, hence `k_ratio`
    "k_ratio": "sqrt(r_2/r_1)",
    **dict.fromkeys(("tilt", "azimuth", "theta0", "ydot0", "betadot0", "thetadot0", "gammadot0", "gap0"), 0.0),
    **{name: 0.0 for wave in WAVES for harmonic in wave for name in harmonic if name not in BASE},
}
# symbols of parameters, in TeX and in plain letters, where `symbol` cannot derive them from the names
SYMBOLS = {
    "beta0": (r"\beta(0)", "β(0)"),
    "xdot0": (r"\dot{x}_1(0)", "ẋ(0)"),
    "phi0": (r"\phi_0", "φ₀"),
    "k_ratio": ("k_2/k_1", "k_2/k_1"),
    "tilt": (r"\mathrm{tilt}", "tilt"),
    "azimuth": (r"\mathrm{azimuth}", "azimuth"),
    "theta0": (r"\theta(0)", "θ(0)"),
    "ydot0": (r"\dot{y}_1(0)", "ẏ(0)"),
    "betadot0": (r"\dot{\beta}(0)", "β\u0307(0)"),
    "thetadot0": (r"\dot{\theta}(0)", "θ\u0307(0)"),
    "gammadot0": (r"\dot{\gamma}(0)", "γ\u0307(0)"),
    "gap0": (r"\delta(0)", "δ(0)"),
}
GREEK = {"Gamma": "Γ", "mu": "μ", "rho": "ρ", "phi": "φ", "eta": "η"}
CAPTION = ("xdot0", "A_r", "e", "Gamma", "f", "mu", "mu_s", "beta0")  # parameters in the captions of the paper


def symbol(name: str, *, tex: bool = False) -> str:
    """Return the symbol of a parameter; a parameter of one end has the number of the end as its index."""
    end = name[-1] if any(name in ends for ends in ENDS.values()) else ""
    both = name.removesuffix(f"_{end}")
    letter, _, below = both.partition("_")
    tex_symbol, plain = SYMBOLS.get(both, (both, both))
    if letter in GREEK:
        tex_symbol = f"\\{letter}_{{{below.replace('_', ',')}}}" if len(below) > 1 else f"\\{both}"
        plain = both.replace(letter, GREEK[letter])
    if not tex:
        return f"{plain}_{end}" if end else plain
    stem, _, index = tex_symbol.partition("_")
    return f"${stem}_{{{index}{',' if index else ''}{end}}}$" if end else f"${tex_symbol}$"


def units_shown(units: str) -> str:
    """Return a unit as it is shown, such as rad/s for rad s-1; "" if there is none."""
    return "" if units == "1" else units.replace(" s-1", "/s").replace(" s-2", "/s²").replace(" m-3", "/m³")


def units_of(name: str) -> str:
    """Return the unit in which values of a parameter are shown, or "" if there is none.

    It is degrees for an angle, and mm for A_z and l.
    """
    return "°" if is_angle(name) else "mm" if name in ("A_z", "l") else units_shown(ACCEPTED[name].units)


def is_angle(name: str) -> bool:
    """Return True if `name` is a parameter that is an angle: its value is in radians, and shown in degrees."""
    return name in PARAMETERS and PARAMETERS[name].units == "rad"


def value_shown(name: str, value: float) -> str:
    """Return a value of a parameter with its unit, such as 15 Hz or 16°."""
    return f"{degrees(value):.4g}°" if is_angle(name) else f"{value:.4g} {units_of(name)}".rstrip()


def parameter_shown(name: str, value: float, *, tex: bool = False) -> str:
    """Return a parameter with its value, such as f = 15 Hz."""
    return f"{symbol(name, tex=tex)} = {value_shown(name, value)}"


def stated(values: Mapping[str, float], varied: Collection[str] = ()) -> dict[str, float]:
    """Return the parameters that hold: the value of both ends where the ends are alike, else the value of each end.

    Parameters
    ----------
    values : mapping of str to float
        Parameters by name; those of `LEFT_OUT` may be missing.
    varied : collection of str
        Parameters that have several values; they are left out.
    """
    kept = {name: values[name] for name in PARAMETERS if name in values and name not in varied}
    for both, ends in ENDS.items():
        own = {end: kept.pop(end, kept.get(both)) for end in ends if end not in varied}
        if len(own) < 2 or len(set(own.values())) > 1:
            kept.pop(both, None)
            kept |= {end: value for end, value in own.items() if value is not None}
        elif None not in own.values():
            kept[both] = own[ends[0]]  # type: ignore[assignment]
    return kept


def conditions(
    values: Mapping[str, float], varied: Collection[str] = (), always: Collection[str] = CAPTION, *, tex: bool = False
) -> str:
    """Return the conditions of a run or of a cube, such as "e = 0.6, f = 15 Hz".

    Spaces within a parameter do not break, so that lines break between parameters only.

    Parameters
    ----------
    values, varied
        See `stated`.
    always : collection of str
        Parameters that are named even with the value of the base case. Others are named where they differ from it.
    tex : bool
        True for symbols in TeX, False for plain letters.
    """
    kept = stated(values, varied)

    def usual(name: str) -> float:
        value = LEFT_OUT.get(name, BASE.get(name, inf))
        return kept.get(value, inf) if isinstance(value, str) else value

    order = [each for name in dict.fromkeys((*CAPTION, *PARAMETERS)) for each in (name, *ENDS.get(name, ()))]
    named = [name for name in dict.fromkeys(order) if name in kept]
    shown = [name for name in named if name in always or not isclose(kept[name], usual(name), rel_tol=1e-12)]
    return ", ".join(parameter_shown(name, kept[name], tex=tex).replace(" ", "\N{NO-BREAK SPACE}") for name in shown)


# numbers of an orbit; each has a change per forcing period, too
ORBIT_NAMES = OUT[:N_ORBIT]
# every variable of a cube besides its axes: columns of the kernel, and quantities that studies add
QUANTITIES = {
    **CODE_COLUMNS,
    **ORBIT_COLUMNS,
    **RUN_COLUMNS,
    "confidence": Quantity("1", "whether the mode stands at other accuracies and from starts beside this one"),
    "error_estimate": Quantity(
        "1", "largest relative error of the orbit (of zeta and impact_phase: absolute), estimated", 0
    ),
    "sustained": Quantity("1", "number of spins at which nothing drifts, that of a plane among them", 0),
    "sustained_spin": Quantity("rad s-1", "axial spin to which the spin is drawn; the least one of a cycle"),
    "sustained_radius": Quantity("m", "radius of the circle of that spin"),
    "sustained_time": Quantity(
        "s", "time in which what is off that spin falls by a factor of 2.718, or once round a cycle"
    ),
    "observer_error": Quantity("1", "why an observer of one's own gave nothing at this point"),
    # variables of a search or a refined map
    "answer": Quantity("1", "answer to the question of the search"),
    "region": Quantity("1", "mode asked for where the answer is yes, else the one mode of all runs"),
    "outcome": Quantity("1", "mode of motion that runs led to"),
    "n_runs": Quantity("1", "number of runs that the answer took", 0),
    "runs": Quantity("1", "number of runs that the answer took, by their mode", 0),
    "axial_velocity": Quantity("m s-1", "mean velocity along the axis from the end that is down to the other one"),
    "computed": Quantity("1", "whether runs were made here; else as the cell around it"),
    "direction": Quantity("1", "direction along the last axis in which the state is carried on"),
    "made_with": Quantity("1", "checksum of the parameters and settings that all runs of the cube were made with", 0),
}

# meaning of each mode of motion; names of quantities stand in backticks
MODE_MEANINGS = {
    "not_run": "the point has not been run",
    "failed": "the run could not be finished, or the `max_seconds` that it was given were up; `status` says which",
    "rest": "both ends stay on the plate and stick; the dimer lies still, or rolls on at a `speed` that does not change",
    "drift": "the motion repeats every forcing period; the raised end lands once, the other one stays down nearly all the time",
    "jump": "both ends leave the plate and land almost together",
    "flutter": "the ends take turns, with a period longer than the forcing period",
    "period_n": "any other motion that repeats, after 1 or more forcing periods; `mode_period` has their number",
    "aperiodic": "bounded, and does not repeat",
    "unresolved": "had not settled within the periods given; ask for more",
    "rolls": "both ends stay on the plate and stick, and `speed` changes, as down a slope; it is that at the end",
    "slides": "both ends stay on the plate, and one or both slip; `speed` is that at the end",
}

# meanings of the other words of a verdict: the end of the double impact of a drift, and the track of a settled motion
DI_END_MEANINGS = {
    "none": "there was no double impact, or the mode is not drift",
    "sp_sp": "both ends slip when the double impact ends",
    "sp_sk": "the end that stays down slips when the double impact ends, the other one sticks",
    "sk_sp": "the end that stays down sticks when the double impact ends, the other one slips",
    "sk_sk": "both ends stick when the double impact ends",
}
TRACK_MEANINGS = {
    "none": "the motion has not settled, or both ends stay down",
    "straight": "the heading has turned by less than 0.1 rad since the motion settled",
    "arc": "the heading has turned by 0.1 rad or more, but not by a whole turn; ask for more periods to see it closed",
    "circle": "the heading has made a whole turn; in the last one the circle's centre moved by less than 1 % of the path",
    "loops": "the centre of the circle moved by more, and the velocity turned along with the heading",
    "waves": "the velocity did not turn along with the heading: the centre moves faster than the circle turns",
    "cusps": "in the last turn, or before the heading turned back, the velocity (its mean over a period) turned by more "
    "than a right angle from one period to the next",
    "reversals": "the heading turned back by more than 0.1 rad, without a cusp, and has made no whole turn since",
}
MOTIONS_PAGE = "docs/motions.md"  # page that explains the modes of motion

# quantities of each event of a recorded run
EVENT_QUANTITIES = {
    "time": Quantity("s", "time since the start", 0),
    "phase": Quantity("rad", "phase of the plate, omega t + phi0, in [0, 2 pi)", 0, 2 * pi),
    "kind": Quantity("1", "contact state during the impact, or from the event on"),
    "cause": Quantity("1", "what happened"),
    "contact_before": Quantity("1", "contact state before the event"),
    "contact_after": Quantity("1", "contact state after the event"),
    "gap_1_rate_before": Quantity("m s-1", "rate of the gap of p1 before the event"),
    "gap_1_rate_after": Quantity("m s-1", "rate of the gap of p1 after the event"),
    "gap_2_rate_before": Quantity("m s-1", "rate of the gap of p2 before the event"),
    "gap_2_rate_after": Quantity("m s-1", "rate of the gap of p2 after the event"),
    **_of_ends("impulse_{}", "N s", "normal impulse of the plate on p{}"),
    "beta": Quantity("rad", "dip angle", -pi / 2, pi / 2),
    "theta": Quantity("rad", "precession angle"),
    "slip_1_a": Quantity("m s-1", "velocity of contact point p1 after the event, along the axis p1-p2"),
    "slip_1_b": Quantity("m s-1", "velocity of contact point p1 after the event, across the axis p1-p2"),
    "slip_2_a": Quantity("m s-1", "velocity of contact point p2 after the event, along the axis p1-p2"),
    "slip_2_b": Quantity("m s-1", "velocity of contact point p2 after the event, across the axis p1-p2"),
}
# quantities of the state of a recorded run at any time
STATE_QUANTITIES = {
    "phase": Quantity("rad", "phase of the plate, omega t + phi0, in [0, 2 pi)", 0, 2 * pi),
    "x1": Quantity("m", "x of the centre of ball 1"),
    "y1": Quantity("m", "y of the centre of ball 1"),
    "z1": Quantity("m", "z of the centre of ball 1"),
    "theta": Quantity("rad", "precession angle"),
    "beta": Quantity("rad", "dip angle", -pi / 2, pi / 2),
    "gamma": Quantity("rad", "spinning angle"),
    "x1_rate": Quantity("m s-1", "x velocity of the centre of ball 1"),
    "y1_rate": Quantity("m s-1", "y velocity of the centre of ball 1"),
    "z1_rate": Quantity("m s-1", "z velocity of the centre of ball 1"),
    "theta_rate": Quantity("rad s-1", "rate of the precession angle"),
    "beta_rate": Quantity("rad s-1", "rate of the dip angle"),
    "gamma_rate": Quantity("rad s-1", "rate of the spinning angle"),
    **_of_ends("gap_{}", "m", "gap between p{} and the plate"),
    **_of_ends("gap_{}_rate", "m s-1", "rate of the gap of p{}"),
    "x": Quantity("m", "x of the centre of mass"),
    "y": Quantity("m", "y of the centre of mass"),
    "z": Quantity("m", "z of the centre of mass"),
    "plate": Quantity("m", "height of the plate over its mean"),
    "contact_state": Quantity("1", "contact state (Table 1 of the paper)"),
}
# former names of two of these, in files of earlier versions. By now `spin` is the axial spin everywhere,
# gamma' + theta' sin(beta)
FORMER_NAMES = {"spin": "gamma", "spin_rate": "gamma_rate"}
# energy of a run in the room at any time, and the forces of the plate on both ends
FORCES = {
    "kinetic_energy": Quantity("J", "kinetic energy in the room", 0),
    "potential_energy": Quantity("J", "potential energy, zero with the centre of mass at the origin of the room"),
    **_of_ends("normal_force_{}", "N", "normal force on p{}"),
    "axial_force": Quantity("N", "sum of the forces of friction on both ends along the axis p1-p2"),
    **_of_ends(
        "axial_force_{}", "N", "friction on p{} along the axis p1-p2; NaN where only the sum of both is determined"
    ),
    **_of_ends("lateral_force_{}", "N", "friction on p{} across the axis p1-p2"),
}
# terms of the energy budget, in the order of the kernel's works; works that take energy from the dimer are negative
WORKS = {
    **_of_ends("plate_{}", "J", "work of the moving plate by its normal force on p{}"),
    "plate_along": Quantity("J", "work of the plate's motion along itself, by friction on both ends"),
    **_of_ends("restitution_{}", "J", "work of the normal force on p{} with its gap rate: what restitution takes"),
    **_of_ends("slip_{}", "J", "work of friction with the slip of p{}"),
    "energy": Quantity("J", "kinetic and potential energy in the room at the end; NaN within an impact"),
    "residual": Quantity("J", "change of that energy less all these works"),
}

# kinds of pictures of a cube
Picture = Literal[
    "segments",
    "mode_map",
    "regions",
    "paths",
    "walks",
    "trends",
    "minimum",
    "impact_ends",
    "shares",
    "planar",
    "bifurcation",
    "circles",
]
PICTURE_KINDS = get_args(Picture)

"""Slots and codes: the places of all numbers in the kernel's flat arrays; names, units and meanings of its results."""

from collections import namedtuple
from dataclasses import dataclass, field, fields
from math import inf, nan, pi
from typing import Annotated, Any, NamedTuple

# --- parameters at rest: one flat row of floats per run -------------------------------------------------------------
HARMONICS = 16  # number of harmonics in the motion of the plate along each axis
# intensity and phase of each harmonic along z, x and y
WAVES = tuple(
    tuple(
        (f"Gamma{axis}{index}", f"phi{axis}{index or first}")
        for index in ("", *(f"_{k}" for k in range(2, HARMONICS + 1)))
    )
    for axis, first in (("", "0"), ("_x", ""), ("_y", ""))
)
DIMER_ROW = (
    "e_1", "e_2", "f", "A_r", "mu_1", "mu_2", "mu_s_1", "mu_s_2", "mu_h_1", "mu_h_2",
    "r_1", "r_2", "rho_b_1", "rho_b_2", "rho_r", "D_r", "g", "eta", "k_ratio", "tilt", "azimuth",
)  # fmt: skip
START_ROW = ("beta0", "xdot0", "theta0", "ydot0", "betadot0", "thetadot0", "gammadot0", "gap0")
ROW = (*DIMER_ROW, *(name for wave in WAVES for harmonic in wave for name in harmonic), *START_ROW)
N_ROW, N_DIMER_ROW = len(ROW), len(DIMER_ROW)
ROW_Z, ROW_X, ROW_Y, ROW_START = (N_DIMER_ROW + 2 * HARMONICS * k for k in range(4))
ROW_PHI0, ROW_BETA0 = ROW_Z + 1, ROW_START


class End:
    """End of the dimer: its ball, and the contact of the ball with the plate."""

    s: float  # -1 for p1, +1 for p2
    r: float  # ball radius [m]
    h: float  # place of the ball's centre on the axis from p1 to p2, from the centre of mass: negative for p1 [m]
    e: float  # energetic restitution [1]
    mu: float  # friction coefficients [1]: slip friction
    mu_hit: float  # slip friction in the impact under way (``friction.hit``)
    mu_s: float  # stick friction inside impacts
    mu_h: float  # stick friction of a lasting contact
    k: float  # stiffness of the contact in impacts, in units of that of p1 [1]


class Split:
    """Result of two forces f_1, f_2, one at each end: w_1 f_1 + w_2 f_2, by their sum and their difference."""

    both: float  # (w_1 + w_2) / 2, per sum of the forces
    apart: float  # (w_1 - w_2) / 2, per difference


class Pair:
    """Delassus operator of both ends where both touch the plate, in units of 1/m.

    The ends share the axial velocity, and normal and lateral motion do not mix.
    """

    nn_1: float
    nn_2: float
    nn_12: float
    na_1: float  # gap rate of p1 per axial impulse, and axial velocity per normal impulse at p1
    na_2: float
    aa: float
    bb_1: float
    bb_2: float
    bb_12: float
    n_1: Split  # gap rates per normal forces
    n_2: Split
    a: Split  # axial velocity per normal forces
    b_1: Split  # lateral velocities per lateral forces
    b_2: Split


class Dimer:
    """Dimer on a plate: a record (``compiler.records``), filled by ``body.set_dimer``."""

    p1: End
    p2: End
    pair: Pair
    l: float  # noqa: E741 (the paper's symbol): distance of the ball centres [m]
    beta_0: float  # dip angle at which both balls can touch the plate: sin(beta_0) = (r_2 - r_1) / l [rad]
    sin_0: float
    cos_0: float
    eta: float  # exponent of the contact in impacts, F = k X^eta [1]
    m: float  # total mass [kg]
    J_t: float  # transverse inertia about the centre of mass (J_1 of the appendix) [kg m2]
    J_a: float  # axial inertia (J_2) [kg m2]
    im: float  # 1/m, 1/J_t, 1/J_a: velocity per impulse
    it: float
    ia: float
    g: float  # gravity along the normal of the plate [m s-2]
    omega: float  # plate angular frequency [rad s-1]
    period: float  # forcing period [s]
    phi0: float  # plate phase at t = 0, reduced to [0, 2 pi) [rad]
    n_z: int  # highest harmonic of the plate along its normal, at least 1; n_along: along its axes X, Y
    n_along: int
    tempo: float  # greatest angular frequency in the motion along the normal [rad s-1]
    most_speed: float  # bounds of the first four time derivatives of the height of the plate [m s-1] to [m s-4]
    most_acceleration: float
    most_jerk: float
    most_snap: float
    # 1.0 where the plate is tilted or moves along itself, else 0.0: then the heading is of no consequence
    sideways: float
    fall_x: float  # gravity along the axes X, Y of the plate [m s-2]
    fall_y: float
    # the lesser of two speeds: g/omega, gained in 1/omega of free fall, and that of a rod tipping over [m s-1]
    v_scale: float
    w_scale: float  # sqrt(g/l), the rate of a rod tipping over [rad s-1]
    A: Annotated[list[float], HARMONICS]  # amplitudes of the harmonics along the normal [m]
    A_sin: Annotated[list[float], HARMONICS]  # the same as factors of sin(k phase), cos(k phase)
    A_cos: Annotated[list[float], HARMONICS]
    G_x: Annotated[list[float], HARMONICS]  # amplitudes of the acceleration along X, Y [m s-2]
    lag_x: Annotated[list[float], HARMONICS]
    G_y: Annotated[list[float], HARMONICS]
    lag_y: Annotated[list[float], HARMONICS]
    # A sin, A cos of the harmonics' angles at the start of a flight [m]: scratch
    sway_s: Annotated[list[float], HARMONICS]
    sway_c: Annotated[list[float], HARMONICS]


# --- state: the closed state in the plate frame, then the cyclic coordinates ----------------------------------------
class State(NamedTuple):
    """Numbers in the slots of a state, for Python: floats, or columns of many states (``State(*states.T)``)."""

    phase: Any = 0.0  # plate phase since the last period boundary [rad], in [0, 2 pi]
    d1: Any = 0.0  # gaps of p1, p2 [m]
    d2: Any = 0.0
    n1: Any = 0.0  # gap rates [m s-1]
    n2: Any = 0.0
    dip: Any = 0.0  # dip angle above that at which both ends touch the plate, beta - beta_0 [rad]
    wb: Any = 0.0  # beta' [rad s-1]
    wp: Any = 0.0  # theta' cos(beta) [rad s-1]
    spin: Any = 0.0  # axial spin gamma' + theta' sin(beta) [rad s-1]
    ca: Any = 0.0  # velocity of the centre of mass along the heading a and the lateral b [m s-1]
    cb: Any = 0.0
    theta: Any = 0.0  # precession angle [rad]
    x1: Any = 0.0  # centre of ball 1 [m]
    y1: Any = 0.0
    gamma: Any = 0.0  # spinning angle [rad]
    period: Any = 0.0  # completed forcing periods (an integer kept as a float, so that time loses no digits)


N_STATE = len(State._fields)
PHASE, D1, D2, N1, N2, DIP, WB, WP, SPIN, CA, CB, THETA, X1, Y1, GAMMA, PERIOD = range(N_STATE)

# --- friction modes of an end ---------------------------------------------------------------------------------------
FREE, STICK, SLIP = 0, 1, 2
IMPACT = 2  # number that an impact at an end adds to its digit in the contact state, see ``contact_code.py``

# --- why an event row was written -----------------------------------------------------------------------------------
CAUSES = ("start", "impact", "chatter_end", "lift_off", "stick", "slip", "end")
C_START, C_IMPACT, C_CHATTER_END, C_LIFT_OFF, C_STICK, C_SLIP, C_END = range(7)

# --- statuses: 0 is kept for a point of a sweep that has not run ------------------------------------------------------
STATUSES = (
    "not_run",
    "ok",
    "max_events",
    "impact_steps",
    "contact_steps",
    "root_steps",
    "jammed",
    "not_finite",
    "record_full",
    "stopped",
)
NOT_RUN, OK, MAX_EVENTS, IMPACT_STEPS, CONTACT_STEPS, ROOT_STEPS, JAMMED, NOT_FINITE, RECORD_FULL, STOPPED = range(10)
STATUS_MESSAGES = (
    "this point has not been run",
    "the run reached its end",
    "the bound on work was reached: bounces that never die out (e near 1?) or a time scale far below a period",
    "an impact took more steps than its bound",
    "a phase of sustained contact took more steps than its bound",
    "the next landing took more steps to find than its bound",
    "no contact force satisfies the friction law (a Painleve configuration that an impact did not resolve)",
    "a number that is not finite appeared in the state",
    "the record is full: ask for fewer periods at a time",
    "the run was stopped from outside, as where its time was up",
)

# --- modes of motion ------------------------------------------------------------------------------------------------
MODES = (
    "not_run", "failed", "rest", "drift", "jump", "flutter", "period_n", "aperiodic", "unresolved", "rolls", "slides",
)  # fmt: skip
M_NOT_RUN, M_FAILED, M_REST, M_DRIFT, M_JUMP, M_FLUTTER, M_PERIOD_N, M_APERIODIC, M_UNRESOLVED = range(9)
M_ROLLS, M_SLIDES = range(9, len(MODES))
BOTH_DOWN = (M_REST, M_ROLLS, M_SLIDES)  # both ends stay on the plate
DOWN_WORDS = tuple(MODES[mode] for mode in BOTH_DOWN)

# --- how the double impact ends -------------------------------------------------------------------------------------
DI_ENDS = ("none", "sp_sp", "sp_sk", "sk_sp", "sk_sk")
DI_NONE, DI_SP_SP, DI_SP_SK, DI_SK_SP, DI_SK_SK = range(5)

# --- what a settled motion draws on the plate (``verdict.track``) -----------------------------------------------------
TRACKS = ("none", "straight", "arc", "circle", "loops", "waves", "cusps", "reversals")
TRACK: Any = namedtuple("TRACK", TRACKS)(*range(8))

# --- outcome of one run: a row of integers and a row of floats, which are columns of cubes and attributes of runs -------


class Quantity(NamedTuple):
    """Unit ("1" if none), meaning and range of a parameter, of a result of a run, or of a label."""

    units: str
    long_name: str
    least: float = -inf
    most: float = inf

    def attributes(self, kind: type = float) -> dict[str, Any]:
        """Return the attributes of a CF variable of a `kind` of number: unit, meaning, finite ends of its range."""
        ends = {"valid_min": self.least, "valid_max": self.most}
        bounds = {name: kind(value) for name, value in ends.items() if abs(value) < inf}
        return {"units": self.units, "long_name": self.long_name} | bounds


def _column(units: str, long_name: str, least: float = -inf, most: float = inf) -> Any:
    """Return the field of a column, without a number by default."""
    return field(default=nan, metadata={"quantity": Quantity(units, long_name, least, most)})


def _columns(kind: Any) -> dict[str, Quantity]:
    """Return the quantities of the columns of a dataclass, by name."""
    return {column.name: column.metadata["quantity"] for column in fields(kind)}


@dataclass(frozen=True, kw_only=True)
class Codes:
    """Row of integers in the outcome of a run."""

    status: int = _column("1", "how the run ended")
    mode: int = _column("1", "mode of motion")
    mode_period: int = _column("1", "period of the motion in forcing periods", 0, 16)
    di_end: int = _column(
        "1", "friction of the end that stays down, then of the other one, at the end of the double impact"
    )
    track: int = _column("1", "what the centre of mass draws on the plate")
    n_events: int = _column("1", "number of landings, impacts, lift-offs and changes between slip and stick", 0)
    n_periods: int = _column("1", "number of forcing periods run", 0)


CODE_COLUMNS = _columns(Codes)
# words of the codes that are flags
CODE_WORDS = {"mode": MODES, "status": STATUSES, "di_end": DI_ENDS, "track": TRACKS}
CODES = tuple(CODE_COLUMNS)
N_CODES = len(CODES)
CODE_STATUS, CODE_MODE, CODE_MODE_PERIOD, CODE_DI_END, CODE_TRACK, CODE_N_EVENTS, CODE_N_PERIODS = range(N_CODES)

_LAST = "the last (at most 16) periods"


def _pace(column: Any) -> Any:
    """Return the field of a column with the change of another column per forcing period."""
    quantity = column.metadata["quantity"]
    return _column(quantity.units, f"change per forcing period: {quantity.long_name}")


@dataclass(frozen=True, kw_only=True)
class OrbitNumbers:
    """Columns of every cube with the orbit of a drift; the speed is also that of a dimer whose ends stay down."""

    radius: float = _column("m", "equivalent radius (11): speed over precession rate; the path's is path_radius", 0)
    period: float = _column("s", "period of the orbit (12), and of its path", 0)
    zeta: float = _column("rad", "angle from the axis p1-p2 to the velocity at the end of the double impact", 0, pi)
    speed: float = _column(
        "m s-1",
        "speed of the centre of mass: at the end of the double impact; of ends that stay down, at the end of the run",
        0,
    )
    precession_rate: float = _column("rad s-1", "mean precession rate over the last forcing period")
    impact_phase: float = _column("1", "phase of the double impact in cycles of the plate", 0, 1)
    radius_drift: float = _pace(radius)
    period_drift: float = _pace(period)
    zeta_drift: float = _pace(zeta)
    speed_drift: float = _pace(speed)
    precession_rate_drift: float = _pace(precession_rate)
    impact_phase_drift: float = _pace(impact_phase)
    spin: float = _column("rad s-1", "axial spin after the double impact")
    beta_rate_after: float = _column("rad s-1", "rate of the dip angle after the double impact")
    path_radius: float = _column("m", "radius of the mean path of the centre of mass, as a camera sees it", 0)
    path_speed: float = _column("m s-1", "speed along the mean path of the centre of mass", 0)


@dataclass(frozen=True, kw_only=True)
class RunNumbers:
    """Columns of every cube with numbers of every run."""

    down_share_1: float = _column("1", f"share of {_LAST} that p1 is down", 0, 1)
    down_share_2: float = _column("1", f"share of {_LAST} that p2 is down", 0, 1)
    settled_after: float = _column("1", "forcing periods until the motion had settled", 0)
    spin_drift: float = _column(
        "rad s-1", "change per forcing period: axial spin (of a drift: after the double impact)"
    )
    longest_hop_1: float = _column("1", f"longest hop of p1 in {_LAST}, in forcing periods", 0)
    longest_hop_2: float = _column("1", f"longest hop of p2 in {_LAST}, in forcing periods", 0)
    change_ahead: float = _column(
        "1", "largest change left out: that of the numbers in the periods that were not run, extrapolated", 0
    )
    centre_velocity_x: float = _column("m s-1", "velocity of the circle's centre along x, over the last whole turn")
    centre_velocity_y: float = _column("m s-1", "velocity of the circle's centre along y, over the last whole turn")


ORBIT_COLUMNS, RUN_COLUMNS = _columns(OrbitNumbers), _columns(RunNumbers)
OUT = (*ORBIT_COLUMNS, *RUN_COLUMNS)
N_OUT = len(OUT)
N_ORBIT = 6  # values of an orbit, which come first, and then as many drifts of them
V_RADIUS, V_PERIOD, V_ZETA, V_SPEED, V_RATE, V_PHASE = range(N_ORBIT)


class Outcome:
    """Row of floats in the order of `OUT`, as the kernel fills it."""

    orbit: Annotated[list[float], N_ORBIT]
    drift: Annotated[list[float], N_ORBIT]
    spin: float
    beta_rate_after: float
    path_radius: float
    path_speed: float
    run: RunNumbers

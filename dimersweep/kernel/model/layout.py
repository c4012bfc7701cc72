"""Slots and codes: what stands where in the kernel's flat arrays, and the names of its integer answers."""

from typing import NamedTuple

# --- parameters at rest: one flat row of floats per run -------------------------------------------------------------
ROW = (
    "e_1", "e_2", "Gamma", "f", "A_r", "mu_1", "mu_2", "mu_s_1", "mu_s_2", "mu_h_1", "mu_h_2", "beta0", "xdot0", "phi0",
    "r_1", "r_2", "rho_b_1", "rho_b_2", "rho_r", "D_r", "g", "Gamma_2", "phi_2", "eta", "k_ratio",
    "tilt", "azimuth", "Gamma_x", "phi_x", "Gamma_y", "phi_y", "theta0", "ydot0", "betadot0", "thetadot0", "gammadot0", "gap0",
)  # fmt: skip
N_ROW = len(ROW)
ROW_BETA0, ROW_XDOT0, ROW_PHI0, ROW_PHI_2 = (ROW.index(name) for name in ("beta0", "xdot0", "phi0", "phi_2"))
ROW_THETA0, ROW_YDOT0, ROW_BETADOT0, ROW_THETADOT0, ROW_GAMMADOT0, ROW_GAP0 = range(ROW.index("theta0"), N_ROW)


class End(NamedTuple):
    """One end of the dimer: its ball, and the contact of that with the plate."""

    s: float  # -1 for p1, +1 for p2
    r: float  # ball radius [m]
    h: float  # place of the ball's centre on the axis from p1 to p2, counted from the centre of mass: negative for p1 [m]
    e: float  # energetic restitution [1]
    mu: float  # slip and stick friction coefficients [1]
    mu_s: float  # stick inside impacts
    mu_h: float  # stick of a lasting contact
    k: float  # stiffness of the contact in impacts, in units of that of p1 [1]


class Dimer(NamedTuple):
    """One dimer on one plate in flight through the kernel: every field a float (an int field would compile again)."""

    p1: End
    p2: End
    l: float  # noqa: E741 (the paper's symbol): distance of the ball centres [m]
    beta_0: float  # dip angle at which both balls can touch the plate: sin(beta_0) = (r_2 - r_1) / l [rad]
    sin_0: float
    cos_0: float
    eta: float  # exponent of the contact in impacts, F = k X^eta [1]
    m: float  # total mass [kg]
    J_t: float  # transverse inertia about the centre of mass (J_1 of the appendix) [kg m2]
    J_a: float  # axial inertia (J_2) [kg m2]
    im: float  # 1/m, 1/J_t, 1/J_a: what an impulse gives
    it: float
    ia: float
    g: float  # gravity along the normal of the plate [m s-2]
    A_z: float  # plate amplitude [m]
    omega: float  # plate angular frequency [rad s-1]
    T: float  # forcing period [s]
    phi0: float  # plate phase at t = 0, reduced to [0, 2 pi) [rad]
    A_2: float  # amplitude of the plate's second harmonic [m]
    lag: float  # its angle where the phase is zero [rad]
    sideways: (
        float  # 1.0 where the plate is tilted or moves along itself, else 0.0: then the heading is of no consequence
    )
    fall_x: float  # gravity along the axes X, Y of the plate [m s-2]
    fall_y: float
    G_x: float  # amplitudes of the acceleration along them, and their angles ahead of the phase [m s-2], [rad]
    lag_x: float
    G_y: float
    lag_y: float
    v_scale: float  # the lesser of g/omega, gained in 1/omega of free fall, and that of a rod tipping over [m s-1]
    w_scale: float  # sqrt(g/l), the rate of a rod tipping over [rad s-1]


# --- state: the closed state in the plate frame, then the cyclic coordinates ----------------------------------------
PHASE = 0  # plate phase since the last period boundary [rad], in [0, 2 pi]
D1, D2 = 1, 2  # gaps of p1, p2 [m]
N1, N2 = 3, 4  # gap rates [m s-1]
DIP = 5  # dip angle above that at which both ends touch the plate, beta - beta_0 [rad]
WB = 6  # beta' [rad s-1]
WP = 7  # theta' cos(beta) [rad s-1]
SPIN = 8  # axial spin gamma' + theta' sin(beta) [rad s-1]
CA, CB = 9, 10  # velocity of the centre of mass along the heading a and the lateral b [m s-1]
THETA = 11  # precession angle [rad]
X1, Y1 = 12, 13  # centre of ball 1 [m]
GAMMA = 14  # spinning angle [rad]
PERIOD = 15  # completed forcing periods (an integer kept as a float, so that time loses no digits)
N_STATE = 16

# --- friction modes of an end ---------------------------------------------------------------------------------------
FREE, STICK, SLIP = 0, 1, 2
IMPACT = 2  # what an impact at an end adds to its digit in the contact state, see ``contact_code.py``

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
MODES = ("not_run", "failed", "rest", "drift", "jump", "flutter", "period_n", "aperiodic", "unresolved")
M_NOT_RUN, M_FAILED, M_REST, M_DRIFT, M_JUMP, M_FLUTTER, M_PERIOD_N, M_APERIODIC, M_UNRESOLVED = range(9)

# --- how the double impact ends -------------------------------------------------------------------------------------
DI_ENDS = ("none", "sp_sp", "sp_sk", "sk_sp", "sk_sk")
DI_NONE, DI_SP_SP, DI_SP_SK, DI_SK_SP, DI_SK_SK = range(5)

# --- outcome of one run: a row of floats and a row of integers --------------------------------------------------------
OUT = (
    "radius",
    "period",
    "zeta",
    "speed",
    "precession_rate",
    "impact_phase",
    "radius_drift",
    "period_drift",
    "zeta_drift",
    "speed_drift",
    "precession_rate_drift",
    "impact_phase_drift",
    "spin_rate",
    "beta_rate_after",
    "down_share_1",
    "down_share_2",
    "settled_after",
    "spin_drift",
    "longest_hop_1",
    "longest_hop_2",
    "change_ahead",
)
N_OUT = len(OUT)
OUT_RADIUS, OUT_PERIOD, OUT_ZETA, OUT_SPEED, OUT_PRECESSION_RATE, OUT_IMPACT_PHASE = range(6)
N_ORBIT = 6  # values of an orbit, in the first slots; the drift of each is so many slots later
OUT_SPIN_RATE, OUT_BETA_RATE_AFTER, OUT_DOWN_SHARE_1, OUT_DOWN_SHARE_2, OUT_SETTLED_AFTER = range(
    2 * N_ORBIT, 2 * N_ORBIT + 5
)
OUT_SPIN_DRIFT, OUT_LONGEST_HOP_1, OUT_LONGEST_HOP_2, OUT_CHANGE_AHEAD = range(2 * N_ORBIT + 5, N_OUT)
CODES = ("status", "mode", "mode_period", "di_end", "n_events", "n_periods")
N_CODES = len(CODES)
CODE_STATUS, CODE_MODE, CODE_MODE_PERIOD, CODE_DI_END, CODE_N_EVENTS, CODE_N_PERIODS = range(N_CODES)

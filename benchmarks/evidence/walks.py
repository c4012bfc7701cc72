"""The walk of unlike balls and on other plates: closed forms beside it, and when it turns back, comes to rest or is lost.

`imperfect.py` prints and draws what these give.
"""

from collections.abc import Callable, Sequence
from math import cos, pi, sin, sqrt, tan
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from dimersweep import Run, orbits, simulate, sweep
from dimersweep.cubes.cube import names
from dimersweep.orbits.guesses import rolled_up
from dimersweep.parameters import Parameters, dimer_from
from tests.oracle import simulate as simulate_slowly

RADIUS = 5e-3  # of the balls of the base case [m]
SETTLED = 30  # periods after which the base case rolls
STOPPED = 0.01  # speed, in that of the start, below which a walk has stopped
SWING = 600  # periods, longer than a walk on the way to rest swings once
SHARP = 1.005  # ratio of the two sides of a border


# --- closed forms -----------------------------------------------------------------------------------------------------
class Response(NamedTuple):
    """How a walk answers to a force across its axis, in closed form, for equal balls.

    Attributes
    ----------
    swing : float
        Turning acceleration of the heading per acceleration across the axis, while p1 rolls and p2 is in the air [1/m].
    turn : float
        Mean turning rate per steady acceleration across the axis [s/m].
    gain : float
        Change of r times the spin per such acceleration and time [1].
    """

    swing: float
    turn: float
    gain: float


def response(parameters: dict[str, float], both_stick: bool = False) -> Response:
    """The response of a dimer of equal balls whose double impact ends with p2 sticking, or with both ends sticking.

    While p1 rolls and p2 is in the air, an acceleration A across the axis needs the friction -A/a at p1, with the inverse
    mass a = 1/m + h^2/J_t + r^2/J_a of an end; it turns the heading by -swing A, swing = h/(J_t a). The impact leaves the
    share q^2 of the turning: the friction at p2 stops p2, which leaves p1 with the share q = 1 - 2 h^2/(J_t a) of its slip,
    and friction takes that in turn. Where both ends stick, it leaves none.
    """
    dm = dimer_from(parameters)
    h, r = dm.p2.h, dm.p1.r
    inverse_mass = 1 / dm.m + h * h / dm.J_t + r * r / dm.J_a
    swing = h / (dm.J_t * inverse_mass)
    left = 0.0 if both_stick else (1 - 2 * h * swing) ** 2
    return Response(swing, 0.5 * swing / parameters["f"] * (1 + left) / (1 - left), 1 / (1 + dm.J_a / (dm.m * r * r)))


def closed_curvature(level: float, ratio: float, **parameters: float) -> float:
    """Curvature of the path of unlike balls, from that of balls of the radius r_1 [1/m].

    Where both ends stick in the impact, the dimer turns there as a cone that rolls about the point in which its axis meets the
    plate: the heading at -s tan(beta_0), beside its turning on the way between. The centre of mass goes with s z_0, where
    z_0 = r_1 + h_1 sin(beta_0) is its height at level. So the curvature of the cone, tan(beta_0)/z_0, is added.
    """
    dm = dimer_from(Parameters(r_1=RADIUS, r_2=RADIUS * ratio, **parameters).given())
    height = dm.p1.r - dm.p1.h * sin(dm.beta_0)
    return level * dm.p1.r / height + tan(dm.beta_0) / height


def slow_walk(response: Response, curvature: float, speed: float, slope: float, azimuth: float) -> tuple[int, bool]:
    """Tops passed before the walk turns back, and whether it does, of the walk in two variables.

    v' = gain A and theta' = -curvature v - turn A with A = slope cos(theta - azimuth), from theta = 0.
    """

    def rates(_: float, y: np.ndarray) -> list[float]:
        across = slope * cos(y[1] - azimuth)
        return [response.gain * across, -curvature * y[0] - response.turn * across]

    def speed_of(_: float, y: np.ndarray) -> float:
        return float(y[0])

    speed_of.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0, 400), [speed, 0.0], events=speed_of, rtol=1e-8, atol=1e-10, max_step=1.0)
    return tops_passed(found.y[1] - azimuth), bool(found.t_events[0].size)


# --- what is computed -------------------------------------------------------------------------------------------------
def curvature_of(orbit: orbits.PeriodicOrbit) -> float:
    """Signed curvature of the path, positive as in the base case [1/m]."""
    return -orbit.precession_rate / orbit.speed


def curvatures(ratios: Sequence[float], **parameters: float) -> tuple[np.ndarray, np.ndarray]:
    """Curvatures of the path at ratios r_2/r_1 of the radii: those of orbits at one spin, and in closed form [1/m]."""
    level = curvature_of(orbits.find(**parameters))
    made = [orbits.find(r_1=RADIUS, r_2=RADIUS * ratio, spin=rolled(parameters), **parameters) for ratio in ratios]
    closed = [closed_curvature(level, ratio, **parameters) for ratio in ratios]
    return np.array([curvature_of(orbit) for orbit in made]), np.array(closed)


def rolled(parameters: dict[str, float]) -> float:
    """Axial spin of a start of alike balls once it rolls [rad/s]."""
    return rolled_up(Parameters(**parameters).given())


def tops_passed(heading: np.ndarray) -> int:
    """How often a walk has passed an uppermost place of its path; headings from the azimuth, that of p2 less a right angle."""
    turns = np.floor((heading + 1.5 * pi) / (2 * pi))
    return int(turns[0] - turns.min())


def walked(run: Run) -> tuple[int, bool]:
    """Tops that the walk of a run passed before it turned back, and whether it did."""
    section = run.section()
    return way(section["theta"].values - run.parameters.get("azimuth", 0.0), section["gamma_rate"].values)


def way(heading: np.ndarray, spin: np.ndarray) -> tuple[int, bool]:
    """Tops passed before the spin changed sign, and whether it did; headings from the azimuth and spins, period by period."""
    back = np.flatnonzero(spin[SETTLED:] < 0)
    return tops_passed(heading[: SETTLED + back[0] + 1] if back.size else heading), bool(back.size)


def turns_back(tilt: float, climb: int, azimuth: float = 0.0, rtol: float = 1e-8) -> bool:
    """Whether the base case turns back before it has passed a top for the `climb`-th time."""
    passed, back = walked(simulate(tilt=tilt, azimuth=azimuth, periods=1000 + 1000 * climb, rtol=rtol))
    if not back and passed < climb:
        raise RuntimeError(f"tilt = {tilt}: not decided after {1000 + 1000 * climb} periods")
    return passed < climb


def comes_to_rest(tilt: float, periods: int, azimuth: float = 0.0, rtol: float = 1e-8) -> bool:
    """Whether the walk of the base case is over after so many periods, and goes on to be for a swing."""
    spin = simulate(tilt=tilt, azimuth=azimuth, periods=periods + SWING, rtol=rtol).section()["gamma_rate"].values
    return bool(np.abs(spin[periods:]).max() < STOPPED * rolled({}))


def caught(tilts: np.ndarray, azimuth: float, rtol: float = 1e-8, **start: float) -> np.ndarray:
    """Whether the base case drifts without spin after 2,400 periods, pointing downhill, at each tilt."""
    plate = {"azimuth": azimuth, **start}
    cube = sweep({"tilt": tilts}, fixed=plate, periods=2400, rtol=rtol, progress=False)
    modes = names(cube["mode"]).values
    if (modes == "failed").any():
        raise RuntimeError(f"azimuth = {azimuth:g}: failed at the tilts {tilts[modes == 'failed']}")
    return (modes == "drift") & (np.abs(cube["spin"].values) < 1.0)


def scan(held: np.ndarray, tilts: np.ndarray) -> tuple[float, float]:
    """The last tilt up to which all are held, and the first from which on none is."""
    return tilts[np.argmin(held) - 1], tilts[np.flatnonzero(held)[-1] + 1]


def border_of(fails: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """The two sides of a border, `SHARP` apart: not so on the first, so on the second."""
    while high / low > SHARP:
        middle = sqrt(low * high)
        low, high = (low, middle) if fails(middle) else (middle, high)
    return low, high


def first_climb(azimuth: float) -> int:
    """The first climb that is not over at once: a start at the uppermost place passes it at its first step."""
    return 2 if azimuth <= -pi / 2 else 1


def turned(tilt: float, climb: int, azimuth: float, answer: Response, bend: float, speed: float) -> bool:
    """Whether the walk in two variables turns back on a climb."""
    passed, back = slow_walk(answer, bend, speed, Parameters().g * sin(tilt), azimuth)
    return back and passed < climb


def locked(Gamma_x: float, rtol: float = 1e-8) -> bool:
    """Whether the heading of the base case stands, or nearly so, on a plate that moves along x, in phase with its shaking."""
    heading = simulate(Gamma_x=Gamma_x, periods=4000, rtol=rtol).section()["theta"].values
    return bool(abs(heading[-1] - heading[-2001]) < pi)


def largest_step(Gamma_x: float) -> float:
    """Largest relative change of the dip angle from one period to the next, once settled, in two turns on such a plate."""
    beta = simulate(Gamma_x=Gamma_x, periods=1500).section()["beta"].values[100:]
    return float(np.abs(np.diff(np.log(beta))).max())


def memory(Gamma_x: float, headings: Sequence[float], periods: int = 24) -> float:
    """Largest relative difference of the dip angle after some periods between starts in two states, at each heading.

    The states are those of a run before and after the step of its dip angle. A start is turned by turning the plate's motion.
    """
    run = simulate(Gamma_x=Gamma_x, periods=1100)
    beta = run.section()["beta"].values
    step = 100 + int(np.argmax(np.abs(np.diff(np.log(beta[100:])))))
    apart = 0.0
    for heading in headings:
        ends = []
        for period in (step - 5, step + 20):
            start = run.states(period / run.parameters["f"])
            along = float(start["theta"]) - heading
            plate = {
                "Gamma_x": abs(Gamma_x * cos(along)),
                "phi_x": 0.0 if cos(along) > 0 else pi,
                "Gamma_y": abs(Gamma_x * sin(along)),
                "phi_y": 0.0 if sin(along) > 0 else pi,
            }
            ends.append(simulate(start=start, periods=periods, **plate).section()["beta"].values[-1])
        apart = max(apart, abs(np.log(ends[1] / ends[0])))
    return float(apart)


def ratio_of(curvature: float, level: float, **parameters: float) -> float:
    """The ratio of the radii with which a path has a curvature, from that of alike balls, by Newton in closed form."""
    ratio = 1.0
    for _ in range(20):
        here = closed_curvature(level, ratio, **parameters)
        slope = (closed_curvature(level, ratio + 1e-6, **parameters) - here) / 1e-6
        ratio += (curvature - here) / slope
    return ratio


def ask_oracle(tilt: float, azimuth: float = 0.0, periods: int = 900, rtol: float = 3e-8, v_rest: float = 1e-6) -> str:
    """What the slow program says of the walk of the base case: whether it passes its first top, or turns back before."""
    given = Parameters(tilt=tilt, azimuth=azimuth).given()
    made = simulate_slowly(given, np.arange(1, periods + 1) / given["f"], rtol, v_rest)
    if made["status"] != "done":
        return str(made["status"])
    passed, back = way(made["samples"][:, 4] - azimuth, made["samples"][:, 12])
    return "passes its first top" if passed else "turns back before its first top" if back else "not decided"

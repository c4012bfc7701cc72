"""The verdict on a run anew, from its record: whole arrays of hops, strobes and double impacts, in the words of the docs."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dimersweep.kernel.model.contact_code import CONTACT_STATES
from dimersweep.kernel.model.event_row import E_A1, E_A2, E_AFTER, E_CAUSE, E_KIND, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import C_CHATTER_END, C_IMPACT, CA, CB, N1, PERIOD, PHASE, SPIN, THETA, WB
from dimersweep.kernel.record import BEFORE, SEGMENT_SLIP

TURN = 2 * np.pi
LONG, NOTED, BURST, BESIDE = 0.5, 0.4, 0.05, 0.15  # in forcing periods
SETTLED, KEPT, WINDOW, LONGEST_PERIOD = 1e-4, 1e-3, 24, 16
FITTED, TOLD, NO_SLIP = 20, 12, 1e-7


Moment = tuple[float, list[str], str, bool]


class Hop(NamedTuple):
    """A time of one end off the plate, in forcing periods; `end` is inf where it is not over."""

    begin: float
    end: float


class Double(NamedTuple):
    """The state after a double impact: time, number of the bouncer, and what is read of the centre of mass and the spins."""

    time: float
    bouncer: int
    speed: float
    zeta: float
    theta: float
    spin: float
    beta_rate: float
    slips: tuple[float, float]  # of p1, p2 [m/s]


def closed(name: str, end: int) -> bool:
    """Whether an end (1 or 2) touches the plate in a contact state of Table 1."""
    return name[0] == "D" or (name[0] == "S" and name[2] == str(end))


def moments(run: Any) -> list[Moment]:
    """Times of the events [periods], the kinds of their rows, the contact after them, and whether there is an impact.

    What a chatter sums lies at its last bounce, as in the kernel's own rows.
    """
    found: list[Moment] = []
    for row in run.record("the test").events:
        time, impact = row[E_PERIOD] + row[E_PHASE] / TURN, row[E_CAUSE] == C_IMPACT
        kind, after = (CONTACT_STATES[int(row[at])] for at in (E_KIND, E_AFTER))
        if found and found[-1][0] == time:
            _, kinds, _, before = found.pop()
            found.append((time, [*kinds, kind], after, impact or before))
        else:
            found.append((time, [kind], after, impact))
    return found


def hops_of(found: Sequence[Moment]) -> tuple[list[Hop], list[Hop]]:
    """Times of p1 and of p2 off the plate, the one that goes on at last; both are on the plate before the start."""
    hops: tuple[list[Hop], list[Hop]] = ([], [])
    for i in (0, 1):
        since = None
        for time, kinds, after, _ in found:
            if since is not None and any(closed(kind, i + 1) for kind in kinds):
                hops[i].append(Hop(since, time))
                since = None
            if since is None and not closed(after, i + 1):
                since = time
        if since is not None:
            hops[i].append(Hop(since, np.inf))
    return hops


def share_down(hops: list[Hop], last: int, over: int, p: int) -> float:
    """Share of the last periods that an end is down: not in a hop of half a period or more.

    One that goes on is as long as the one a period p before, or long if p is 0.
    """
    long = [hop for hop in hops if hop.end - hop.begin >= LONG]
    if p and not any(hop.begin < last - p < hop.end for hop in long):
        long = [hop for hop in long if hop.end < np.inf]
    off = [min(hop.end, last) - max(hop.begin, last - over) for hop in long]
    return 1 - sum(max(0.0, time) for time in off) / over


def longest_hop(hops: list[Hop], last: int, over: int) -> float:
    """Longest hop that ended within the last periods or goes on."""
    ended = [hop.end - hop.begin for hop in hops if last - over < hop.end <= last]
    going = [last - hop.begin for hop in hops if hop.end == np.inf]
    return max([0.0, *ended, *going])


def doubles_of(run: Any, found: Sequence[Moment], flights: tuple[list[Hop], list[Hop]]) -> list[Double]:
    """Double impacts: an end comes from a long flight while the other one is down, or both touch.

    Each goes on to its last impact within a burst.
    """
    record = run.record("the test")
    times = record.segments[:, PERIOD] + record.segments[:, PHASE] / TURN
    landings = [{hop.end: hop for hop in hops} for hops in flights]
    doubles: list[Double] = []
    before = "FM"
    for time, kinds, after, impact in found:
        contact, before = before, after
        if not impact:
            continue
        landed = [landings[i].get(time) for i in (0, 1)]
        begins, bouncer = False, None
        for i in (1, 0):
            hop = landed[i]
            if hop is not None and hop.end - hop.begin >= LONG and bouncer is None:
                begins = not any(o.begin < time < o.end and time - o.begin >= LONG for o in flights[1 - i])
                bouncer = i
        if bouncer is None:
            touching = [i for i in (0, 1) if landed[i] or (closed(contact, i + 1) and closed(kinds[0], i + 1))]
            bouncer = touching[0] if touching else 0
        both = kinds[0].startswith("D")
        near = bool(doubles) and time - doubles[-1].time < BURST
        if near and (both or doubles[-1].bouncer == bouncer):
            doubles[-1] = double_at(record, times, time, doubles[-1].bouncer)
        elif not near and (both or begins):
            doubles.append(double_at(record, times, time, bouncer))
    return doubles


def double_at(record: Any, times: np.ndarray, time: float, bouncer: int) -> Double:
    """The state right after the last impact at a time, before the hops of a chatter are summed."""
    k = int(np.flatnonzero(np.abs(times - time) < 1e-12)[-1])
    segment = record.segments[k].copy()
    rows = record.events[np.abs(record.events[:, E_PERIOD] + record.events[:, E_PHASE] / TURN - time) < 1e-12]
    if (rows[:, E_CAUSE] == C_CHATTER_END).any():
        segment[N1 : CB + 1] = segment[BEFORE:SEGMENT_SLIP]
    c = np.array([segment[CA], segment[CB]])
    speed = float(np.sqrt(c @ c))
    forward = (c[0] if bouncer == 1 else -c[0]) / speed if speed else np.nan
    slips = [np.sqrt(rows[-1][at] ** 2 + rows[-1][at + 1] ** 2) for at in (E_A1, E_A2)]
    return Double(
        time, bouncer, speed, float(np.arccos(forward)), segment[THETA], segment[SPIN], segment[WB], tuple(slips)
    )


def orbit_numbers(run: Any, doubles: list[Double]) -> dict[str, np.ndarray]:
    """Quantities of an orbit at each double impact but the first."""
    T = 1 / run.parameters["f"]
    t, theta = np.array([one.time for one in doubles]) * T, np.array([one.theta for one in doubles])
    speed = np.array([one.speed for one in doubles])[1:]
    rate = np.diff(theta) / np.diff(t)
    phase = t / T + run.parameters["phi0"] / TURN
    with np.errstate(divide="ignore"):
        return {
            "radius": np.where(rate == 0, np.nan, speed / np.abs(rate)),
            "period": np.where(rate == 0, np.nan, TURN / np.abs(rate)),
            "zeta": np.array([one.zeta for one in doubles])[1:],
            "speed": speed,
            "precession_rate": rate,
            "impact_phase": np.mod(phase, 1.0)[1:],
            "spin": np.array([one.spin for one in doubles])[1:],
            "beta_rate_after": np.array([one.beta_rate for one in doubles])[1:],
        }


def slope(values: np.ndarray) -> float:
    """Slope of the last values per step, by least squares."""
    last = values[-FITTED:]
    return float(np.polyfit(np.arange(last.size), last, 1)[0])


def strobes_of(run: Any) -> tuple[np.ndarray, np.ndarray]:
    """Gaps and gap rates at the period boundaries, and the spin, in units of g and omega: shapes (n, 4), (n,)."""
    f, g = run.parameters["f"], run.parameters["g"]
    omega = TURN * f
    states = run.states(np.arange(1, run.n_periods + 1) / f)
    gaps = [states[f"gap_{end}"].values * omega**2 / g for end in (1, 2)]
    rates = [states[f"gap_{end}_rate"].values * omega / g for end in (1, 2)]
    spin = states["gamma_rate"].values + states["theta_rate"].values * np.sin(states["beta"].values)
    return np.column_stack([*gaps, *rates]), spin


class Course:
    """For how long a motion on a level plate has repeated with each period, at each of its period boundaries.

    Parameters
    ----------
    x : ndarray, shape (n, 4)
        Gaps and gap rates at the boundaries, in g/omega^2 and g/omega.
    roll : ndarray, shape (n,)
        Spins there times the radius of the greater ball, in g/omega.
    """

    def __init__(self, x: np.ndarray, roll: np.ndarray) -> None:
        self.x, self.roll = x, roll
        self.runs = np.zeros((len(x), LONGEST_PERIOD + 1), int)
        for p in range(1, LONGEST_PERIOD + 1):
            for k in range(p, len(x)):
                kept = self.runs[k - 1, p] >= WINDOW + p
                repeats = self.residual(p, k) <= (KEPT if kept else SETTLED)
                self.runs[k, p] = self.runs[k - 1, p] + 1 if repeats else 0

    def residual(self, p: int, k: int) -> float:
        """How far the strobe of boundary `k` is from one that repeats over p periods."""
        x = self.x
        moved = np.abs(x[k] - x[k - p]).max()
        if moved <= SETTLED or k < 2 * p or moved > abs(self.roll[k] - self.roll[k - p]):
            return moved
        return min(moved, WINDOW * np.abs(x[k] - 2 * x[k - p] + x[k - 2 * p]).max())

    def worst(self, p: int, k: int, stretch: int) -> float:
        """The largest residual of so many strobes up to boundary `k`."""
        return max(self.residual(p, k - back) for back in range(stretch))

    def period(self) -> int:
        """Period of the motion at the end, 0 if it has neither settled nor is seen to."""
        last, periods = len(self.x) - 1, range(1, LONGEST_PERIOD + 1)
        settled = [p for p in periods if self.runs[last, p] >= WINDOW + p and not self.shortens(p, last)]
        ringing = [p for p in periods if not settled and self.rings_down(p, last) and not self.shortens(p, last)]
        return min([*settled, *ringing], default=0)

    def rings_down(self, p: int, k: int) -> bool:
        """Whether the fast part falls to a half from each third of the last periods to the next, to below what counts."""
        if k + 1 < WINDOW + 2 * p:
            return False
        third = WINDOW // 3
        old, middle, new = (self.worst(p, k - back * third, third) for back in (2, 1, 0))
        return middle <= 0.5 * old and new <= 0.5 * middle and new <= SETTLED

    def shortens(self, p: int, k: int) -> bool:
        """Whether a motion of period p repeats, or comes nearer to repeating, with a divisor of p."""
        divisors = [q for q in range(1, p) if p % q == 0]
        return any(self.runs[k, q] >= p or self.worst(q, k, p) < 0.99 * self.worst(q, k - WINDOW, p) for q in divisors)


def told_over(p: int) -> int:
    """Periods over which shares and hops of a motion of period p are told."""
    return p * max(1, TOLD // p) if p else TOLD


def mode_of(p: int, last: int, hops: tuple[list[Hop], list[Hop]], doubles: Sequence[Double]) -> str:
    """Name of a motion of period p."""
    span = told_over(p)
    doubles = [one for one in doubles if last - span < one.time <= last]
    down = [share_down(hops[i], last, span, p) for i in (0, 1)]
    if p == 1 and len(doubles) == span and max(down) >= 0.9 and min(down) <= 0.5:
        return "drift"
    landings = sorted((hop.end, i, hop.end - hop.begin) for i in (0, 1) for hop in hops[i])
    landings = [one for one in landings if one[2] >= NOTED and one[0] < np.inf]
    long = [one for one in landings if one[2] >= LONG and one[0] >= last - span]
    together = [any(o[1] != one[1] and abs(o[0] - one[0]) < BESIDE for o in landings) for one in long]
    if all(together) if long else len(doubles) >= span / p:
        return "jump"
    turns = sum(a[1] != b[1] for a, b in pairwise(long))
    return "flutter" if p > 1 and len(long) >= 2 and turns == len(long) - 1 else "period_n"


def verdict(run: Any) -> dict[str, Any]:
    """Numbers and words of a recorded run on a level plate that made all its periods, by their names."""
    n, found = run.n_periods, moments(run)
    hops = hops_of(found)
    doubles = doubles_of(run, found, hops)
    told: dict[str, Any] = {}
    x, spin = strobes_of(run)
    r = max(run.parameters.get(name, 0.0) for name in ("r", "r_1", "r_2"))
    course = Course(x, r * spin * TURN * run.parameters["f"] / run.parameters["g"])
    p = course.period()
    told["mode_period"] = p
    over = min(n - 1, told_over(p))
    for i in (0, 1):
        told[f"down_share_{i + 1}"] = share_down(hops[i], n, over, p)
        told[f"longest_hop_{i + 1}"] = longest_hop(hops[i], n, over)
    if p == 0:
        return told
    told["settled_after"] = n - int(course.runs[n - 1, p])
    span = p * (WINDOW // p)
    told["spin_drift"] = (spin[-1] - spin[-1 - span]) / span
    told["mode"] = mode_of(p, n, hops, doubles)
    if told["mode"] == "drift":
        numbers = orbit_numbers(run, doubles)
        told |= {name: values[-1] for name, values in numbers.items()}
        drifting = ("radius", "period", "zeta", "speed", "precession_rate", "impact_phase")
        told |= {f"{name}_drift": slope(numbers[name]) for name in drifting}
        told["spin_drift"] = slope(numbers["spin"])
        least = NO_SLIP * run.parameters["g"] / (TURN * run.parameters["f"])
        ends = ["sk" if slip <= least else "sp" for slip in doubles[-1].slips]
        bouncer = doubles[-1].bouncer
        told["di_end"] = f"{ends[1 - bouncer]}_{ends[bouncer]}"
    return told

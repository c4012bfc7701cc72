"""A recorded run looked at phase by phase: how deep an end is below the plate, and what energy comes from nothing.

Energies are those in the plate's frame, in units of the largest energy of the run and that of the plate's speed.
What comes from nothing: the gain of kinetic energy in an impact (the plate has no speed there, friction and restitution only
take); the change of the total energy of the lab in flight; the gain in sustained contact beyond the work of the effective
gravity g + z_p'', which comes from a quadrature of known error. The impact that closes a chatter stands apart: it
cancels the last hop, and with it the friction that this hop would have given back.
"""

from math import pi
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.batch import run_recorded, run_request
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.event_row import EVENT
from dimersweep.kernel.model.layout import (
    CODES,
    D1,
    D2,
    DIP,
    FREE,
    HARMONICS,
    N_CODES,
    N_OUT,
    N_STATE,
    PERIOD,
    PHASE,
    SLIP,
    State,
)
from dimersweep.kernel.model.plate import motion, motion_along
from dimersweep.kernel.record import SEGMENT_HOP_TIME, SEGMENT_MODES, new_record, no_record, rows_of, was_full
from dimersweep.kernel.sample import sample

CODE = {name: k for k, name in enumerate(CODES)}
LOG_ROWS, FIRST_ROWS, MOST_ROWS = 400, 2000, 200_000
SAME = 1e-13  # events closer than this, in forcing periods, are at one moment
# where a phase is looked at: at last shortly before its end, so that a slip that turns fast is not taken for one that flips
INSIDE = np.append(0.5 - 0.5 * np.cos(pi * np.arange(1, 12) / 12), 1.0 - 1e-4)
RULES = tuple((0.5 * (nodes + 1.0), 0.5 * weights) for nodes, weights in map(np.polynomial.legendre.leggauss, (8, 12)))
STATES = sum(len(nodes) for nodes, _ in RULES)  # looked at in a panel
HALVINGS = 12  # of a phase for the quadrature in it, at most
SAMPLES = 20_000  # states of a scene, beyond one panel a phase, after which no panel is halved
DOUBT = 1e-13  # about the work in a part of a phase, over the energy of the scene, that ends its halving
KINDS = ("flight", "impact", "contact", "close")
# penetration over length, and energy from nothing over that of the scene, from which a run lies
SUNK, GAINED = 1e-14, 1e-9
STRICT = 1e-11  # accuracy of the run that shows whether energy comes from nothing


def attempt(row, periods, rtol, rows):
    """Status, number of events, event rows and segments of one run, at most `rows` of each; and whether these are all."""
    codes, kept = np.zeros((1, N_CODES), np.int64), new_record(rows, LOG_ROWS)
    run_recorded(row, run_request(periods, rtol, path=True), np.zeros((1, N_OUT)), codes, kept)
    fits = codes[0, CODE["status"]] != layout.RECORD_FULL and not was_full(kept)
    status, n_events = layout.STATUSES[codes[0, CODE["status"]]], int(codes[0, CODE["n_events"]])
    return (status, n_events, *rows_of(kept)), fits


def record(row, periods, rtol):
    """Status, number of events, event rows and segments of one run, or None where the record would be too long."""
    rows = FIRST_ROWS
    while rows <= MOST_ROWS:
        taken, fits = attempt(row, periods, rtol, rows)
        if fits:
            return taken
        rows *= 10
    return None


def of_centre(dm, first, second):
    """Height of the centre of mass over that where both ends touch the plate, or its rate, from both gaps or gap rates."""
    return (dm.p2.h * first - dm.p1.h * second) / dm.l


def kinetic(dm, states):
    """Kinetic energy in the plate's frame [J]; states of shape (..., N_STATE)."""
    s = State(*np.moveaxis(states, -1, 0))
    moving = dm.m * (s.ca**2 + s.cb**2 + of_centre(dm, s.n1, s.n2) ** 2)
    return 0.5 * (moving + dm.J_t * (s.wb**2 + s.wp**2) + dm.J_a * s.spin**2)


def total(dm, states):
    """Kinetic energy in the plate's frame and that of the height above it [J]; states of shape (n, N_STATE)."""
    return kinetic(dm, states) + dm.m * dm.g * of_centre(dm, states[:, D1], states[:, D2])


def plate_energy(dm):
    """Energy of the dimer at the greatest speed of the plate [J]."""
    along = (dm.G_x[0] ** 2 + dm.G_y[0] ** 2) / dm.omega**2
    return 0.5 * dm.m * (dm.most_speed**2 + along)


def over_plate(dm, states):
    """Place and velocity of the centre of mass over the plate, along its axes and its normal; shapes (3, n)."""
    s = State(*states.T)
    sin_t, cos_t, h = np.sin(s.theta), np.cos(s.theta), dm.p1.h * np.cos(dm.beta_0 + s.dip)
    place = np.array([s.x1 + h * sin_t, s.y1 - h * cos_t, of_centre(dm, s.d1, s.d2)])
    rates = s.cb * cos_t - s.ca * sin_t, s.ca * cos_t + s.cb * sin_t, of_centre(dm, s.n1, s.n2)
    return place, np.array(rates)


def of_plate(dm, states):
    """Place and velocity of the plate along its axes and its normal at the times of states; shapes (3, n)."""
    phase = states[:, PHASE] + dm.phi0
    (x, y, v_x, v_y), (z, rate, _) = motion_along(dm, phase), motion(dm, phase)
    return np.array([x, y, z]), np.array([v_x, v_y, rate])


def lab_gain(dm, starts, ends):
    """Change of the dimer's total energy in the lab's frame over flights; states of shape (n, N_STATE) [J]."""
    (r_0, c_0), (r_1, c_1) = (over_plate(dm, states) for states in (starts, ends))
    (q_0, p_0), (q_1, p_1) = (of_plate(dm, states) for states in (starts, ends))
    frame = dm.m * (c_1 * p_1 - c_0 * p_0 + 0.5 * (p_1 - p_0) * (p_1 + p_0)).sum(0)
    fall = dm.m * np.array([-dm.fall_x, -dm.fall_y, dm.g]) @ (r_1 - r_0 + q_1 - q_0)
    return kinetic(dm, ends) - kinetic(dm, starts) + frame + fall


def states_at(row, segments, phases, rtol):
    """Kernel states in the phases that start with each of the segments; nan where sampling fails.

    Parameters
    ----------
    phases : ndarray, shape (n, k)
        Plate phases [rad], counted as those of the segment; at most the one of the next segment.

    Returns
    -------
    ndarray, shape (n, k, N_STATE)
    """
    n, k = phases.shape
    states, modes = np.zeros((n * k, N_STATE)), np.zeros((n * k, 2))
    segments = segments.copy()
    segments[:, SEGMENT_HOP_TIME] = 0.0  # the run is looked at, which has summed these hops
    which = np.repeat(np.arange(n), k)
    sample(row, segments, which, phases.ravel(), rtol, new_workspace(), no_record(), states, modes, np.zeros((0, 0)))
    return states.reshape(n, k, N_STATE)


def integrals(row, segments, span, rtol, rate_of, allowed):
    """Integrals of a rate over phases, by Gauss rules on panels that are halved until two rules agree.

    Parameters
    ----------
    segments : ndarray, shape (n, N_SEGMENT)
        What the phases start from.
    span : ndarray, shape (n,)
        Their durations in plate phase [rad].
    rtol : float
        Accuracy of the states in them.
    rate_of : callable
        The rate at states of shape (m, k, N_STATE) in phases with numbers of shape (m,); shape (m, k), per rad.
    allowed : float
        Difference of the two rules in a panel that ends its halving.

    Returns
    -------
    total, doubt : ndarray, shape (n,)
        The doubt is the sum of the differences, far above the error of the finer rule.
    """
    total, doubt = np.zeros(len(span)), np.zeros(len(span))
    which, left, width = np.arange(len(span)), np.zeros(len(span)), np.ones(len(span))
    panels = 0
    for halving in range(HALVINGS + 1):
        if not len(which):
            break
        coarse, fine = (
            (rate_of(states_at(row, segments[which], at, rtol), which) @ weights) * width * span[which]
            for nodes, weights in RULES
            for at in [segments[which, PHASE, None] + (left[:, None] + width[:, None] * nodes) * span[which, None]]
        )
        apart = np.abs(fine - coarse)
        panels += len(which)
        done = (apart <= allowed) | (halving == HALVINGS) | (STATES * (panels - len(span)) > SAMPLES)
        np.add.at(total, which[done], fine[done])
        np.add.at(doubt, which[done], apart[done])
        which, left, width = (np.repeat(values[~done], 2) for values in (which, left, 0.5 * width))
        left[1::2] += width[1::2]
    return total, doubt


def contact_gains(dm, row, segments, span, rise, rtol, unit):
    """Gain of energy in contact phases beyond the work of the effective gravity, and the doubt about that work [J]."""

    def power(states, which):
        return dm.m / dm.omega * gravity_power(dm, State(*np.moveaxis(states, -1, 0)))

    work, doubt = integrals(row, segments, span, rtol, power, DOUBT * unit)
    return rise - work, doubt


def gravity_power(dm, s):
    """Power of the effective gravity along the normal and along the plate, per mass [W/kg]; of columns of states."""
    phase = s.phase + dm.phi0
    down = dm.g + motion(dm, phase)[2]
    orders = np.arange(1, HARMONICS + 1)
    a_x, a_y = (
        fall + (G * np.sin(np.multiply.outer(phase, orders) + lag)).sum(axis=-1)
        for fall, G, lag in ((dm.fall_x, dm.G_x, dm.lag_x), (dm.fall_y, dm.G_y, dm.lag_y))
    )
    sin_t, cos_t = np.sin(s.theta), np.cos(s.theta)
    along = a_x * (s.cb * cos_t - s.ca * sin_t) + a_y * (s.ca * cos_t + s.cb * sin_t)
    return along - down * of_centre(dm, s.n1, s.n2)


def slips(dm, states):
    """Axial and lateral slip of p1 and of p2 [m/s], shape (n, 2, 2)."""
    s = State(*states.T)
    sin_b, cos_b = np.sin(dm.beta_0 + s.dip), np.cos(dm.beta_0 + s.dip)
    along = [s.ca + (p.r - p.h * sin_b) * s.wb for p in (dm.p1, dm.p2)]
    across = [s.cb + (p.r * sin_b - p.h) * s.wp - p.r * cos_b * s.spin for p in (dm.p1, dm.p2)]
    return np.array([along, across]).transpose(2, 1, 0)


def flips(dm, rtol, before, after, was, now):
    """Slips that turn round from one side of an event that is no impact to the other; columns are the ends."""
    old, new = slips(dm, before), slips(dm, after)
    tolerance = rtol * (dm.v_scale + dm.p2.h * dm.w_scale)
    fast = np.hypot(new[..., 0], new[..., 1]) > 100 * tolerance
    return int((((old * new).sum(2) < 0.0) & fast & (was == SLIP) & (now == SLIP)).sum())


def largest(values):
    """The largest of some values, 0.0 if there is none; nan does not count."""
    return float(np.fmax.reduce(np.ravel(values), initial=0.0))


def examine(row, periods, rtol):
    """What a recorded run shows, or None where its record would be too long.

    Where energy is gained, the run is examined once more with more digits: what is gained there too, is no error of
    the accuracy asked for, but comes from nothing.

    Returns
    -------
    dict
        status, n_events; penetration [m] and the scale of length it is measured by [m]; gain by kind of phase, in units of
        the energy of the scene; nothing and rtol, the same of what comes from nothing, and the accuracy of the run that
        showed it; doubt about the gain in contact; flips, the number of slips that turn round at an event that is no
        impact; crowd, the largest number of event rows at one moment; dip, the largest in size [rad]; nan, whether a number
        of the record is none.
    """
    taken = record(row, periods, rtol)
    if taken is None:
        return None
    look = look_at(row, rtol, *taken)
    if rtol <= STRICT or max(look["gain"].values()) <= GAINED:
        return look
    again, fits = attempt(row, periods, STRICT, MOST_ROWS)
    nothing = look_at(row, STRICT, *again)["gain"] if fits else gain_in_parts(row, rtol, taken, again)
    return look | {"nothing": nothing, "rtol": STRICT}


def gain_in_parts(row, rtol, taken, begun):
    """Gain by kind of a run whose record with more digits goes on for a part of it only: the greater one of the two parts.

    Each part counts in units of its own energy, which is at most that of the whole scene.
    """
    reached = min(event_times(begun[2])[-1], segment_times(begun[3])[-1])
    first = look_at(row, STRICT, *begun[:3], begun[3][segment_times(begun[3]) < reached])["gain"]
    later = taken[3][segment_times(taken[3]) >= reached]
    if len(later) < 2:
        return first
    rest = look_at(row, rtol, *taken[:3], later)["gain"]
    return {kind: max(first[kind], rest[kind]) for kind in KINDS}


def event_times(events):
    """Times of event rows, in forcing periods."""
    return events[:, EVENT.index("period")] + events[:, EVENT.index("phase")] / (2 * pi)


def segment_times(segments):
    """Times at which segments begin, in forcing periods."""
    return segments[:, PERIOD] + segments[:, PHASE] / (2 * pi)


class Phases(NamedTuple):
    """The smooth phases of a run, each with what ends it; arrays with one row a phase."""

    segments: np.ndarray  # what it starts from, with the friction modes
    span: np.ndarray  # its duration in plate phase [rad]
    ends: np.ndarray  # states just before what ends it, just after
    after: np.ndarray
    after_modes: np.ndarray
    struck: np.ndarray  # whether an impact ends it, or an impact with the close of a chatter
    closed: np.ndarray


def phases_of(row, rtol, events, segments):
    """The smooth phases of a record; of several segments at one moment only the last counts."""
    times, at = segment_times(segments), event_times(events)
    causes = events[:, EVENT.index("cause")]
    segments = segments[np.append(np.diff(times) > 0.0, True)[: len(segments)]]
    times = segment_times(segments[1:])
    span = 2 * pi * np.diff(segments[:, PERIOD]) + np.diff(segments[:, PHASE])
    closed = np.isin(times, at[causes == layout.C_CHATTER_END])
    struck = np.isin(times, at[causes == layout.C_IMPACT]) & ~closed
    jumps = closed | struck
    after = segments[1:, :N_STATE]
    ends = after.copy()
    ends[jumps] = states_at(row, segments[:-1][jumps], (segments[:-1, PHASE] + span)[jumps, None], rtol)[:, 0]
    return Phases(segments[:-1], span, ends, after, segments[1:, SEGMENT_MODES:SEGMENT_HOP_TIME], struck, closed)


def look_at(row, rtol, status, n_events, events, segments):
    """What the record of a run shows: see `examine`."""
    dm = dimer_of(row)
    segments, span, ends, after, after_modes, struck, closed = phases_of(row, rtol, events, segments)
    starts, modes = segments[:, :N_STATE], segments[:, SEGMENT_MODES:SEGMENT_HOP_TIME]
    smooth = ~closed & ~struck
    inner = states_at(row, segments, starts[:, PHASE, None] + span[:, None] * INSIDE, rtol)
    free = (modes == FREE).all(1)
    at_rest = (modes != FREE).all(1)
    rise = kinetic(dm, ends) - kinetic(dm, starts)
    jump = kinetic(dm, after) - kinetic(dm, ends)
    still = at_rest & (dm.sideways == 0.0)  # gravity does no work there
    leans = ~free & ~still
    most = max(largest(total(dm, starts)), largest(total(dm, ends))) + plate_energy(dm)
    leaning, doubt = contact_gains(dm, row, segments[leans], span[leans], rise[leans], rtol, most)
    found = {
        "flight": np.abs(lab_gain(dm, starts[free], ends[free])),
        "impact": jump[struck],
        # where the work is in doubt by more than is asked, what is gained beyond the doubt
        "contact": np.concatenate([rise[still], np.where(doubt > GAINED * most, leaning - doubt, leaning)]),
        "close": jump[closed],
    }
    seen = np.concatenate([inner.reshape(-1, N_STATE), ends])
    gaps = seen[:, [D1, D2]]
    gain = {kind: float(largest(values) / most) if most else 0.0 for kind, values in found.items()}
    return {
        "status": status,
        "rtol": rtol,
        "n_events": n_events,
        "penetration": largest(-gaps),
        "length": float(max(dm.l, dm.A.sum(), largest(gaps))),
        "gain": gain,
        "nothing": gain,
        "doubt": float(largest(doubt) / most) if most else 0.0,
        "flips": flips(dm, rtol, inner[smooth, -1], after[smooth], modes[smooth], after_modes[smooth]),
        "crowd": crowd(event_times(events)),
        "dip": largest(np.abs(seen[:, DIP])),
        "nan": not (np.isfinite(segments).all() and np.isfinite(seen).all()),
    }


def crowd(times):
    """Largest number of event rows at one moment."""
    if not len(times):
        return 0
    starts = np.concatenate([[0], np.flatnonzero(np.diff(times) > SAME) + 1, [len(times)]])
    return int(np.diff(starts).max())


def lies(look):
    """What is wrong with a recorded run that says it is ok; in contact, energy is only kept to its accuracy."""
    allowed = {"flight": GAINED, "impact": GAINED, "contact": GAINED + 10 * look["rtol"], "close": GAINED}
    found = {
        "sinks": look["penetration"] > SUNK * look["length"],
        "gains energy": any(look["nothing"][kind] > most for kind, most in allowed.items()),
        "flips": look["flips"] > 0,
        "nan": look["nan"],
    }
    return [name for name, wrong in found.items() if wrong] if look["status"] == "ok" else []

"""Works of the contact forces in a phase of sustained contact, by Gauss and Kronrod's rules on panels.

The phase is integrated anew, at its own accuracy, from one place of the rule to the next; at each the forces of the contact
work with the velocity of the plate and with the slip of the ends.
"""

import numpy as np

from dimersweep.kernel.compiler.jit import compiled
from dimersweep.kernel.contact.coordinates import N_Y, UPRIGHT, YAXES, YCHART, YTHETA, kernel_state, slip_of
from dimersweep.kernel.contact.events import NO_EVENT, OUT_OF_STEPS, is_slip_end
from dimersweep.kernel.contact.forces import A1, F1, F2, L1, contact_rates
from dimersweep.kernel.energy.impact_work import ALONG, N_WORK, PLATE_1, PLATE_2, SLIP_1
from dimersweep.kernel.model.friction import direction
from dimersweep.kernel.model.layout import PHASE, SLIP
from dimersweep.kernel.model.plate import plate_rate, velocity_along
from dimersweep.kernel.numerics.meter import set_bound
from dimersweep.kernel.numerics.sincos import sincos
from dimersweep.kernel.numerics.steps import copy
from dimersweep.kernel.sample import begin_contact, follow_to_event, sustain
from dimersweep.kernel.smooth_motion import no_slip

# Kronrod's 15 places in [-1, 1], his weights, and those of Gauss at every second one (QUADPACK's qk15)
# fmt: off
_HALF = (
    (0.991455371120812639206854697526329, 0.022935322010529224963732008058970, 0.0),
    (0.949107912342758524526189684047851, 0.063092092629978553290700663189204, 0.129484966168869693270611432679082),
    (0.864864423359769072789712788640926, 0.104790010322250183839876322541518, 0.0),
    (0.741531185599394439863864773280788, 0.140653259715525918745189590510238, 0.279705391489276667901467771423780),
    (0.586087235467691130294144691693, 0.169004726639267902826583426598550, 0.0),
    (0.405845151377397166906606412076961, 0.190350578064785409913256402421014, 0.381830050505118944950369775488975),
    (0.207784955007898467600689403773245, 0.204432940075298892414161999234649, 0.0),
)
# fmt: on
_PLACES = [
    *((-x, k, g) for x, k, g in _HALF),
    (0.0, 0.209482141084727828012999174891714, 0.417959183673469387755102040816327),
    *_HALF[::-1],
]
PLACES = np.array([0.5 * (1.0 + x) for x, _, _ in _PLACES])
KRONROD = np.array([0.5 * k for _, k, _ in _PLACES])
GAUSS = np.array([0.5 * g for _, _, g in _PLACES])
N_PLACES = 15
# what a power at the places comes to at the end of the panel, by Lagrange's polynomial; at its start in the opposite order
AT_END = np.array([np.prod([(1.0 - p) / (q - p) for p in PLACES if p != q]) for q in PLACES])
UNSEEN = 1.0 - PLACES[-1]  # share of a panel at either end that has no place
WORK_DOUBT = 1e-13  # of the work in a panel, in units of the energy of the motion and of the plate
LONGEST, SHORTEST = 0.25, 1e-10  # panel, in forcing periods
PANEL_BOUND = 5e3  # of the cost of a panel's steps, in hops of one end: one that costs more is taken again, shorter
# rows of the scratch array, beyond those of an impact's
S_KRONROD, S_GAUSS, S_POWER, S_BEGUN, S_START, S_FIRST, S_LAST, S_FLOW = range(8)
CONTACT_ROWS = 8


@compiled
def powers(dm, motion, phase, power):
    """Powers of the contact forces at the contact state of a run, into `power` [W]."""
    modes, y, F = motion.modes, motion.contact, motion.forces
    contact_rates(dm, modes, phase, y, False, motion.rates, F)
    rise = plate_rate(dm, phase)
    for k in range(N_WORK):
        power[k] = 0.0
    power[PLATE_1], power[PLATE_2] = F[F1] * rise, F[F2] * rise
    axial, lateral = F[A1] + F[A1 + 3], F[L1] + F[L1 + 3]
    if dm.sideways != 0.0:
        v_x, v_y = velocity_along(dm, phase)
        sin_t, cos_t = sincos(y[YAXES] if y[YCHART] == UPRIGHT else y[YTHETA])
        power[ALONG] = axial * (v_y * cos_t - v_x * sin_t) + lateral * (v_x * cos_t + v_y * sin_t)
    both_slip = modes[0] == SLIP and modes[1] == SLIP
    for i in range(2):
        if modes[i] == SLIP:
            a, b = slip_of(dm, modes, y, i)
            share = F[A1 + 3 * i]
            if both_slip:
                c, _ = direction(a, b)
                share = -(dm.p1.mu if i == 0 else dm.p2.mu) * F[F1 + 3 * i] * c
            power[SLIP_1 + i] = share * a + F[L1 + 3 * i] * b


@compiled
def go_to(dm, motion, phase, span, tol, locate):
    """Carry the contact state on by a time; returns NO_EVENT, the end of a slip that comes before, or OUT_OF_STEPS.

    With `locate` it looks for events as the run does; what comes shortly before the end of the phase, no slip's, goes unheeded.
    """
    done, event = 0.0, NO_EVENT
    if locate:
        done, event = follow_to_event(dm, motion, phase, span, tol)
        if event == NO_EVENT or is_slip_end(event) or event == OUT_OF_STEPS:
            return event
    _, event = sustain(dm, motion, phase + dm.omega * done, span - done, tol, False)
    return OUT_OF_STEPS if event == OUT_OF_STEPS else NO_EVENT


@compiled
def panel(dm, motion, phase, h, tol, locate, rows):
    """Works over a panel of the length h by both rules, what flows either way, the contact state at its end, and what the
    powers at both ends have beyond those at the places: a slip may turn between the last place and the end.

    Returns
    -------
    int
        NO_EVENT, the end of a slip before the last place of the rules, or OUT_OF_STEPS.
    """
    set_bound(motion.meter, PANEL_BOUND)
    powers(dm, motion, phase, rows[S_START])
    for k in range(N_WORK):
        rows[S_KRONROD, k], rows[S_GAUSS, k], rows[S_FIRST, k], rows[S_LAST, k] = 0.0, 0.0, rows[S_START, k], 0.0
        rows[S_FLOW, k] = 0.0
    at = 0.0
    for j in range(N_PLACES):
        event = go_to(dm, motion, phase + dm.omega * h * at, h * (PLACES[j] - at), tol, locate)
        if event != NO_EVENT:
            return event
        at = PLACES[j]
        powers(dm, motion, phase + dm.omega * h * at, rows[S_POWER])
        for k in range(N_WORK):
            rows[S_KRONROD, k] += h * KRONROD[j] * rows[S_POWER, k]
            rows[S_GAUSS, k] += h * GAUSS[j] * rows[S_POWER, k]
            rows[S_FLOW, k] += h * KRONROD[j] * abs(rows[S_POWER, k])
            rows[S_FIRST, k] -= AT_END[N_PLACES - 1 - j] * rows[S_POWER, k]
            rows[S_LAST, k] -= AT_END[j] * rows[S_POWER, k]
    event = go_to(dm, motion, phase + dm.omega * h * at, h * (1.0 - at), tol, locate)
    if event == NO_EVENT:
        powers(dm, motion, phase + dm.omega * h, rows[S_POWER])
        for k in range(N_WORK):
            rows[S_LAST, k] += rows[S_POWER, k]
    else:  # of a slip that has ended there is no power
        for k in range(N_WORK):
            rows[S_LAST, k] = 0.0
    return OUT_OF_STEPS if event == OUT_OF_STEPS else NO_EVENT


@compiled
def doubt(h, rows, unit):
    """What the works over a panel of the length h may be off: the difference of both rules, and what they do not see at the
    ends. It bears slips that turn fast as well.
    """
    worst = 0.0
    for k in range(N_WORK):
        unseen = UNSEEN * h * max(abs(rows[S_FIRST, k]), abs(rows[S_LAST, k]))
        worst = max(worst, max(unseen, abs(rows[S_KRONROD, k] - rows[S_GAUSS, k])) / unit)
    return worst


@compiled
def contact_work(dm, motion, span, rtol, tol, unit, rows, done, flow):
    """Works of the contact forces over a phase of sustained contact; the kernel state goes to its end.

    Parameters
    ----------
    motion : Motion
        Its state and modes are those at the start of the phase.
    span : float
        Duration of the phase [s].
    rtol, tol : float
        Accuracy of the run, and that of the phase.
    unit : float
        Energy of the motion and of the plate [J].
    rows : float64 array, shape (CONTACT_ROWS, at least N_Y)
        Scratch.
    done, flow : float64 arrays, shape (N_WORK,)
        Filled in place with the works, and with the integrals of the powers' sizes [J].

    Returns
    -------
    bool
        Whether the steps that a phase may take were enough.
    """
    state, y, begun = motion.state, motion.contact, rows[S_BEGUN]
    motion.course[0].slip_tol = no_slip(dm, state, rtol)
    start = state[PHASE] + dm.phi0
    begin_contact(dm, motion)
    locate, shortened, t, h = True, False, 0.0, min(span, LONGEST * dm.period)
    for k in range(N_WORK):
        done[k], flow[k] = 0.0, 0.0
    copy(y, begun, N_Y)
    while t < span:
        h = min(h, span - t)
        look = locate and t + h >= span  # what ends the phase is at the end of the last panel
        event = panel(dm, motion, start + dm.omega * t, h, tol, look, rows)
        sound = event == NO_EVENT
        if (not sound or doubt(h, rows, unit) > WORK_DOUBT) and h > SHORTEST * dm.period:
            h, shortened = 0.5 * h, True
            copy(begun, y, N_Y)
            continue
        if not sound:
            if h + t >= span:  # the slip ends before its phase does, by the rounding of both
                for k in range(N_WORK):
                    done[k] += h * rows[S_START, k]
                    flow[k] += h * abs(rows[S_START, k])
                break
            if event == OUT_OF_STEPS:
                return False
            locate = False
            copy(begun, y, N_Y)
            continue
        copy(y, begun, N_Y)
        for k in range(N_WORK):
            done[k] += rows[S_KRONROD, k]
            flow[k] += rows[S_FLOW, k]
        t = span if t + h >= span * (1.0 - 1e-15) else t + h
        if not shortened or h <= SHORTEST * dm.period:
            h = min(2.0 * h, LONGEST * dm.period)
        shortened = False
    kernel_state(dm, motion.modes, y, state)
    state[PHASE] += dm.omega * span
    return True

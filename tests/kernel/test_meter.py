"""Work: what is charged, where it is bounded, and that a run can be stopped within a phase or an impact."""

import numpy as np
import pytest

from dimersweep.kernel.batch import run_many, stop
from dimersweep.kernel.contact.coordinates import N_Y
from dimersweep.kernel.contact.events import NO_EVENT, OUT_OF_STEPS
from dimersweep.kernel.contact.step_control import EXPLICIT_COST
from dimersweep.kernel.course import BUDGET, BUDGET_PER_PERIOD, new_workspace
from dimersweep.kernel.model.layout import CB, CODES, IMPACT_STEPS, N1, N2, N_CODES, N_OUT, N_STATE, OK, SLIP, STATUSES
from dimersweep.kernel.smooth_motion import CONTACT_COST
from dimersweep.parameters import Parameters
from tests.checks.random_scenes import rows_of
from tests.checks.verbs import collide_double, contact_state, dimer, scratch, sustain_contact

ONE_MORE = 200.0  # work that may be done between two looks at the meter: one step with the location of its event


def slide(work):
    """A contact phase of a slide on both ends over a period: its time, the span and the event."""
    dm, state, y, codes = dimer(Gamma=0.5), np.zeros(N_STATE), np.zeros(N_Y), np.array([SLIP, SLIP], dtype=float)
    state[CB] = 1.0
    contact_state(dm, state, -1.0, y)
    span = dm.period
    t, event = sustain_contact(dm, codes, y, 0.0, span, 1e-10, 1e-11, work)
    return t, span, event


def test_each_step_of_a_contact_phase_is_charged():
    work, _ = scratch()
    t, span, event = slide(work)
    assert (t, event) == (span, NO_EVENT)
    steps = work.meter[0].spent / EXPLICIT_COST
    assert steps >= 2
    assert steps == pytest.approx(round(steps))


@pytest.mark.parametrize("slot", ["bound", "stop"])
def test_a_contact_phase_ends_within_where_the_meter_is_over(slot):
    work, _ = scratch()
    setattr(work.meter[0], slot, EXPLICIT_COST if slot == "bound" else True)
    t, span, event = slide(work)
    assert event == OUT_OF_STEPS
    assert t < span
    assert work.meter[0].spent <= work.meter[0].bound + EXPLICIT_COST


@pytest.mark.parametrize("slot", ["bound", "stop"])
def test_an_impact_at_both_ends_ends_within_where_the_meter_is_over(slot):
    dm, modes = dimer(e=0.6), np.zeros(2)
    state = np.zeros(N_STATE)
    state[N1], state[N2], state[CB] = -1.0, -0.5, 0.3
    work, log = scratch()
    assert collide_double(dm, state.copy(), 1.0, 1e-8, modes, work, log)[0] == OK
    whole = work.meter[0].spent
    assert whole > 5
    work, log = scratch()
    setattr(work.meter[0], slot, 0.5 * whole if slot == "bound" else True)
    assert collide_double(dm, state.copy(), 1.0, 1e-8, modes, work, log)[0] == IMPACT_STEPS
    assert work.meter[0].spent < whole


def outcome_of(rows, periods, space):
    """Status of the last of some runs."""
    out, codes = np.full((len(rows), N_OUT), np.nan), np.zeros((len(rows), N_CODES), np.int64)
    run_many(rows, periods, 1e-8, False, out, codes, 0, space)
    return STATUSES[codes[-1, CODES.index("status")]]


@pytest.mark.jit
def test_no_wild_scene_does_more_work_than_its_bound():
    space, most = new_workspace(), 0.0
    for row in rows_of(0, 300, 2, "wild"):
        outcome_of(row[None], 1, space)
        most = max(most, space.work.meter[0].spent)
    assert CONTACT_COST < most <= BUDGET + BUDGET_PER_PERIOD + ONE_MORE


def test_a_stopped_run_tells_so():
    space = new_workspace()
    stop(space)
    assert outcome_of(Parameters().row()[None], 3, space) == "stopped"

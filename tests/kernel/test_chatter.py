"""The close of a chatter: hops that die out gain no energy where they are summed, and hops without end are lost when faint."""

import numpy as np
import pytest

from dimersweep.kernel.chatter import CLOSE_COST, SPREAD
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.layout import CA, CB, D1, D2, N1, N2, N_STATE, SPIN, STATUSES, THETA, WB, WP, X1, Y1
from tests.checks.examine import STRICT, look_at, record
from tests.checks.launch import last_state
from tests.checks.random_scenes import scene_row

pytestmark = pytest.mark.jit
GROWTH = 10.0  # of the rate of faint hops in a period, with the weight on the end


def scales(dm):
    """Units of a kernel state."""
    unit = np.ones(N_STATE)
    unit[[D1, D2]], unit[[X1, Y1]] = dm.p2.h, dm.p1.r
    unit[[N1, N2, CA, CB]], unit[[WB, WP, SPIN]] = dm.v_scale, dm.w_scale
    return unit


@pytest.mark.parametrize("number", [23753, 33641])
def test_faint_hops_that_are_lost_cost_what_their_number_allows(number):
    """A period of elastic hops, all of them followed, and the same with the end of them where they are faint."""
    rtol = 1e-7
    row = scene_row(number, 11, "far")
    status, events, state = last_state(row, 1, rtol, rtol)
    followed, more, expected = last_state(row, 1, rtol, 1e-24)
    assert STATUSES[status] == STATUSES[followed] == "ok"
    assert more > 20 * events
    off = np.abs(state - expected)[: Y1 + 1] / scales(dimer_of(row))[: Y1 + 1]
    assert 0.0 < max(off[[N1, N2]]) < GROWTH * max(CLOSE_COST, SPREAD * events) * rtol
    assert off.max() < GROWTH * max(CLOSE_COST, SPREAD * events) * rtol
    assert max(off[[CA, CB, SPIN, THETA, X1, Y1]]) < 0.1 * max(off[[N1, N2]])  # the hops are about a mean motion


@pytest.mark.parametrize("number", [593, 833, 1179, 1275, 1451, 1472, 1614, 1992])
def test_the_close_of_a_chatter_gains_no_energy(number):
    """Beside an end that sticks the other one slips slowly: cancelling its hop would give it back a friction it has not had."""
    row = scene_row(number, 11, "far")
    look = look_at(row, STRICT, *record(row, 5, STRICT))
    assert look["status"] == "ok"
    assert look["gain"]["close"] < 10 * STRICT

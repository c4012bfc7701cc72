"""A steep rod in contact: its rates in the upright chart are those by the heading, where both describe it."""

import numpy as np
import pytest

from dimersweep.kernel.contact.coordinates import N_Y, UPRIGHT, Y
from dimersweep.kernel.contact.forces import COMPLIANCE, N_F
from dimersweep.kernel.model.layout import CA, CB, DIP, FREE, GAMMA, N_STATE, SLIP, SPIN, STICK, THETA, WB, WP, X1, Y1
from tests.checks.verbs import contact_rates, contact_state, contact_velocity, dimer, kernel_state

UNLIKE = {"r_1": 5e-3, "r_2": 6e-3, "mu_1": 0.3, "mu_2": 0.2, "mu_s_1": 0.5, "mu_s_2": 0.5}
ALONG = {"tilt": 0.1, "azimuth": 0.8, "Gamma_x": 0.2, "phi_x": 0.3, "Gamma_y": 0.4, "phi_y": 2.0}
MOVING = [DIP, WB, WP, SPIN, CA, CB, THETA, X1, Y1, GAMMA]


def steep(dm, i, mode, seed):
    """A state of a rod that stands on end i, beyond the border of the charts."""
    rng, state = np.random.default_rng(seed), np.zeros(N_STATE)
    state[DIP] = (1.49 if i == 0 else -1.49) - dm.beta_0
    state[[WB, WP, SPIN, CA, CB]] = rng.normal(size=5) * [2.0, 0.3, 60.0, 0.3, 0.3]
    state[[THETA, X1, Y1, GAMMA]] = rng.uniform(-1, 1, 4)
    if mode == STICK:
        _, a, b = contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
        state[CA], state[CB] = state[CA] - a, state[CB] - b
    return state


def by_heading(dm, i, state):
    """The contact state in the chart by heading, which `contact_state` leaves there."""
    y = np.zeros(N_Y)
    _, a, b = contact_velocity(dm, state, -1.0 if i == 0 else 1.0)
    y[: Y.u_a + 2] = *state[[DIP, WB, WP, SPIN]], a, b
    y[[Y.x - 2, Y.x, Y.y, Y.gamma]] = state[[THETA, X1, Y1, GAMMA]]
    return y


def change_of(dm, modes, y, step):
    """Rate of the kernel state where a contact state goes on at its rates, and the size of the forces."""
    dy, F, ends = np.zeros(N_Y), np.zeros(N_F), np.zeros((2, N_STATE))
    contact_rates(dm, modes, 0.7, y, dy, F)
    for end, by in zip(ends, (step, -step), strict=True):
        kernel_state(dm, modes, y + by * dy, end)
    forces = F[:COMPLIANCE].reshape(2, 3)
    return ((ends[0] - ends[1]) / (2 * step))[MOVING], forces[:, 0], np.hypot(forces[:, 1], forces[:, 2]), F[COMPLIANCE]


@pytest.mark.parametrize("mode", [STICK, SLIP])
@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_both_charts_give_a_rod_the_same_rates_and_forces(seed, i, mode):
    dm = dimer(**UNLIKE, **ALONG)
    modes = np.full(2, float(FREE))
    modes[i] = mode
    state = steep(dm, i, mode, seed)
    heading, upright = by_heading(dm, i, state), np.zeros(N_Y)
    contact_state(dm, state, -1.0 if i == 0 else 1.0, upright)
    assert upright[Y.chart] == UPRIGHT != heading[Y.chart]
    expected, found = (change_of(dm, modes, y, 1e-6) for y in (heading, upright))
    for one, other in zip(expected, found, strict=True):
        scale = np.abs(one).max()
        np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-7 * scale)
    assert Y.dip < Y.time < Y.x

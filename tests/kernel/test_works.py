"""Works that ride along with impacts: against those that the oracle integrates for itself."""

import numpy as np
import pytest

from dimersweep.kernel.model.layout import N1, N2, OK
from dimersweep.kernel.model.works import ALONG, N_WORK, PLATE_1, REST_1, SLIP_1, STRUCK_ROWS
from tests import oracle
from tests.checks.verbs import collide_double, collide_single, dimer, oracle_state, scratch, state_of
from tests.kernel.test_double_impact import random_flat

SIGNS = (-1.0, 1.0)


def works_of(dm, before, tol, end=None):
    """Works of an impact at both ends, or at one: of the normal forces and of friction, shape (2, 2), and a unit of them."""
    (work, log), state = scratch(), before.copy()
    V = -float(min(state[N1], state[N2]) if end is None else state[N1 + end])
    work.course[0].tally.wanted = True
    if end is None:
        status, rows = collide_double(dm, state, V, tol, np.zeros(2), work, log)
    else:
        status, _, rows = collide_single(dm, state, SIGNS[end], V, tol, work, log)
    assert status == OK
    total = work.rows[-STRUCK_ROWS:][:rows, :N_WORK].sum(0)
    assert not total[PLATE_1 : ALONG + 1].any()  # the plate is at rest
    works = np.array([total[REST_1 : REST_1 + 2], total[SLIP_1 : SLIP_1 + 2]])
    return works, max(dm.m * V**2, np.abs(works).max())


@pytest.mark.parametrize("seed", range(30))
def test_works_of_impacts_at_one_end(seed):
    rng, end = np.random.default_rng([7, seed]), seed % 2
    mu = rng.uniform(0, 1) * (seed % 8 > 0)
    params = {"A_r": rng.uniform(2, 9), "mu": mu, "mu_s": mu * rng.uniform(1, 2), "e": rng.uniform(0.1, 1)}
    dm, q = dimer(**params), np.array([0, 0, 0, rng.uniform(-3, 3), rng.uniform(-1.4, 1.4), 0])
    qdot = rng.normal(size=6) * [0.5, 0.5, 0.1, 2, 5, 80]
    qdot *= -np.sign(state_of(dm, q, qdot)[N1 + end])
    found, unit = works_of(dm, state_of(dm, q, qdot), 1e-10, end)
    _, told = oracle.impact(params, q, qdot, (end == 0, end == 1))
    assert np.abs(found - told["work"]).max() < 1e-8 * unit


@pytest.mark.slow
@pytest.mark.jit
@pytest.mark.parametrize("seed", range(40))
def test_works_of_impacts_at_both_ends(seed):
    rng = np.random.default_rng([9, seed])
    params = {name: rng.uniform(3e-3, 6e-3) for name in ("r_1", "r_2")} if seed % 3 == 0 else {}
    mu = rng.uniform(0, 0.8)
    params |= {"A_r": rng.uniform(3, 9), "mu": mu, "mu_s": mu * rng.choice([1, 1.5]), "eta": rng.choice([1.0, 1.5])}
    params |= {"e_1": rng.uniform(0.05, 1), "e_2": rng.uniform(0.05, 1)}
    dm = dimer(**params)
    before = random_flat(dm, rng, seed)
    q, qdot = oracle_state(dm, before)
    found, unit = works_of(dm, state_of(dm, q, qdot), 1e-10)
    _, told = oracle.impact(params, q, qdot)
    assert np.abs(found - told["work"]).max() < 1e-7 * unit

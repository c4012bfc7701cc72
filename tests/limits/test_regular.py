"""The impact law in its regular form, by itself, gives the engine's impacts."""

from importlib.util import find_spec, module_from_spec

import numba
import numpy as np
import pytest

from tests.oracle import body

from .cases import engine_impact


def uncompiled(name):
    """A copy of a module whose functions are plain Python: to compile them takes longer than all that is asked here."""
    found = find_spec(name)
    module = module_from_spec(found)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "DISABLE_JIT", True)
        found.loader.exec_module(module)
    return module


regular = uncompiled("tests.limits.regular")


def contact_velocities(d, q, qdot):
    """Gap rates, the axial slip of end 1 and the lateral slips, at theta = 0."""
    slips = body.slips(d, q, qdot)
    return np.array([*body.gap_rates(d, q, qdot), slips[0, 1], slips[0, 0], slips[1, 0]])


def responses(d, q):
    """Of the end in question to impulses at it and at the other: normal, axial from normal, axial, lateral, times the mass."""
    G = d.m * body.delassus(d, q)[0]
    i = 1 if q[4] == 0 else 0
    return [np.array([G[i, 0, j, 0], G[i, 2, j, 0], G[i, 2, j, 2], G[i, 1, j, 1]]) for j in (i, 1 - i)]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # of steps and probes that are not taken
@pytest.mark.jit
@pytest.mark.parametrize(("mu", "mu_s"), [(0.2, 0.4), (0.05, 0.1), (0.5, 0.6), (0.0, 0.0)])
def test_impacts_in_the_regular_form_are_those_of_the_engine(mu, mu_s):
    rng = np.random.default_rng([1, int(100 * mu)])
    for trial in range(20):
        given = {"mu": mu, "mu_s": mu_s, "e": rng.uniform(0.2, 0.9), "A_r": rng.uniform(3, 8)}
        d, q, qdot, double = (
            body.dimer(given),
            np.zeros(6),
            rng.normal(size=6) * [0.3, 0.3, 0, 5, 0, 50],
            trial % 2 == 0,
        )
        q[4] = 0.0 if double else rng.uniform(0.05, 0.6)
        n = (rng.choice([0, 0.2, -0.3]), -0.5) if double else (-0.4, rng.normal())
        qdot[2], qdot[4] = n[0], (n[1] - n[0]) / (d.l * np.cos(q[4]))
        if trial % 4 > 1:  # one end does not slip
            qdot[:2] -= body.slips(d, q, qdot)[0]
        before, after = (contact_velocities(d, q, each) for each in (qdot, engine_impact(given, q, qdot)))
        V, space = -min(n if double else n[:1]), np.zeros(regular.SPACE)
        law = regular.law_of(*responses(d, q), d.e[0], mu, mu_s, 1e-13 / V, 1e-13 / V)
        if double:
            slots = [regular.ZN1, regular.ZN2, regular.ZA, regular.ZB1, regular.ZB2]
            space[regular.STATE, slots] = before / V
            well, found, expected = regular.two_ends(law, space), space[regular.STATE, slots], after / V
        else:
            well, *found = regular.one_end(law, *(before[[0, 2, 3]] / V), space)
            expected = after[[0, 2, 3]] / V
        assert well
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8, err_msg=str(given))

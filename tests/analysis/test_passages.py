"""The map of points in one call of the kernel, and what it reads off a passage, against the rows of the record read anew."""

from dataclasses import replace

import numpy as np
import pytest

from dimersweep import orbits
from dimersweep.analysis.orbits.map import poincare
from dimersweep.analysis.orbits.map.finding import ball_state, checked, first_map
from dimersweep.analysis.orbits.map.lost import OrbitLost
from dimersweep.analysis.orbits.map.passage import TURN
from dimersweep.kernel.model.contact_code import digits_of
from dimersweep.kernel.model.event_row import E_AFTER, E_BEFORE, E_CAUSE, E_KIND, E_PERIOD, E_PHASE
from dimersweep.kernel.model.layout import C_START, CA, CB, FREE, IMPACT, N1, PERIOD, PHASE, SPIN, THETA
from dimersweep.kernel.record import BEFORE, SEGMENT_MODES, SEGMENT_SLIP
from dimersweep.kernel.section import SPIN_COORDINATE
from dimersweep.parameters import Parameters, fill_rows
from tests.checks.dimers import random_dimer

PERIODS = 4


@pytest.fixture(scope="module")
def orbit():
    return orbits.find(Gamma=0.9, spin=100.0)


def hop_of(passage, end):
    events = passage.events
    struck = digits_of(events[:, E_KIND])[end] > IMPACT
    before, after = (digits_of(events[:, column])[end] for column in (E_BEFORE, E_AFTER))
    touched = (events[:, E_CAUSE] != C_START) & (struck | (before > 0) | (after > 0))
    times = (events[:, E_PERIOD] * TURN + events[:, E_PHASE])[touched]
    leaves = (after[touched] == 0) | (after[touched] > IMPACT)
    return np.diff(times, append=times[:1] + passage.times[-1])[leaves].max(initial=0.0) if touched.any() else 0.0


def strike_of(passage):
    """State after the last impact of the end that is in the air for longer, and that end."""
    airborne = np.diff(passage.times) @ (passage.segments[:-1, SEGMENT_MODES : SEGMENT_MODES + 2] == FREE)
    end = int(airborne[1] >= airborne[0])
    (rows,) = np.nonzero(digits_of(passage.events[:, E_KIND])[end] > IMPACT)
    if not rows.size:
        return None, end
    last = passage.events[rows[-1]]
    at = np.searchsorted(passage.times, last[E_PERIOD] * TURN + last[E_PHASE])
    state = passage.segments[at, : PERIOD + 1].copy()
    state[N1 : CB + 1] = passage.segments[at, BEFORE:SEGMENT_SLIP]
    return state, end


@pytest.mark.parametrize("seed", range(8))
def test_hops_and_strikes_are_those_of_the_rows(seed):
    parameters = random_dimer(seed)
    m = first_map(checked({name: value for name, value in parameters.items() if name != "spin"}), PERIODS, 1e-8)
    state, _, passage = m.recorder.run(m.row, ball_state(m, parameters.get("spin", 50.0)), PERIODS, m.rtol)
    read = passage.read
    assert passage.hops == (hop_of(passage, 0), hop_of(passage, 1))
    assert max(passage.hops) > 0.0
    struck, end = strike_of(passage)
    assert read.theta == state[THETA]
    assert bool(read.strikes) == (struck is not None)
    if struck is not None:
        told = (read.spin, read.turned, read.phase)
        assert told == (struck[SPIN], struck[THETA], struck[PHASE])
        forward = struck[CA] if end == 1 else -struck[CA]
        assert read.speed == pytest.approx(np.hypot(struck[CA], struck[CB]), rel=1e-14)
        assert read.zeta == pytest.approx(np.arctan2(abs(struck[CB]), forward), rel=1e-14)


def test_derivatives_are_one_call_of_the_kernel(orbit, monkeypatch):
    m, calls, images = orbit.fixed.map, [], poincare.images

    def counted(*given):
        calls.append(len(given[2]))
        return images(*given)

    monkeypatch.setattr(poincare, "images", counted)
    matrix, gradient = m.jacobian(orbit.fixed.z)
    assert calls == [2 * orbit.fixed.z.size]
    assert (matrix == orbit.fixed.matrix).all()
    assert (gradient == orbit.fixed.gradient).all()


def test_images_of_many_points_are_those_of_each(orbit):
    m, z = orbit.fixed.map, orbit.fixed.z
    points = z + 1e-3 * np.random.default_rng(0).normal(size=(5, z.size)) * (np.arange(z.size) != m.slow)
    for own in (m, replace(m, spin=100.0, back=1.0)):
        each = [own.passage(point) for point in points]
        assert (own.images(points) == [[*one.point, one.spin / own.unit] for one in each]).all()
        chain = own.chain(points[0], 3)
        assert (chain[2].point == own.passage(own.passage(each[0].point).point).point).all()
        assert chain[1].sequence == own.passage(each[0].point).sequence


@pytest.mark.parametrize("back", [0.0, 1.0])
@pytest.mark.parametrize("periods", [1, 2])
def test_the_spin_is_put_back_in_each_period(orbit, back, periods):
    spin = 99.0
    m = replace(orbit.fixed.map, spin=spin, back=back, periods=periods)
    state, row, since = m.state(orbit.fixed.z), m.row_at(back), (m.phase - back) % TURN
    for k in range(periods):
        state[PHASE] = since if k == 0 else 0.0
        state, modes, _ = m.recorder.run(row, state, 1, m.rtol)
        point, theta, before = m.section.point(state), state[THETA], state[SPIN]
        point[SPIN_COORDINATE] = spin / m.unit
        state = m.section.state(point, modes)
        state[THETA] = theta
    state[PHASE] = TURN - since
    state, _, passage = m.recorder.run(m.row, state, 1, m.rtol)
    image = m.passage(orbit.fixed.z)
    assert image.point == pytest.approx(m.section.point(state)[m.free], abs=1e-13)
    assert (image.spin, image.theta) == pytest.approx((before, state[THETA]), rel=1e-13)
    assert image.events.shape == passage.events.shape


@pytest.mark.parametrize(
    "name", ["Gamma", "e", "e_2", "r", "r_1", "mu", "mu_s", "f", "phi0", "Gamma_2", "tilt", "k_ratio"]
)
def test_a_step_of_a_parameter_changes_its_columns(name):
    given = Parameters(mu=0.3, mu_s=0.4).given()
    m = first_map(given)
    for value in (3.1e-3, 3.2e-3) if name in ("r", "r_1") else (0.31, 0.32):
        moved = m.at(name, value)
        assert (moved.plain_row == fill_rows(given | {name: value}, 1)[0]).all()
        assert (moved.row == first_map(given | {name: value}).row).all()
        assert moved.unit == first_map(given | {name: value}).unit
        m = moved
    if name != "phi0":
        with pytest.raises(OrbitLost, match="must be"):
            m.at(name, -1e9)

"""Walks of unlike balls and on tilted plates are what the closed forms say, and turn back on one side of a border only."""

from math import atan, pi

import numpy as np
import pytest
from imperfect import RATIOS
from walks import (
    RADIUS,
    caught,
    closed_curvature,
    comes_to_rest,
    curvature_of,
    curvatures,
    ratio_of,
    response,
    rolled,
    slow_walk,
    turned,
    turns_back,
    way,
)

from dimersweep import orbits, simulate
from dimersweep.cubes.reading import circle_through
from dimersweep.parameters import Parameters

pytestmark = pytest.mark.jit
BASE = Parameters()


def fitted_curvature(ratio):
    """Curvature of a circle through the path of a run [1/m]."""
    section = simulate(r_1=RADIUS, r_2=RADIUS * ratio, periods=700).section()
    return 1 / circle_through(section["x"].values[100:], section["y"].values[100:])[2]


def test_the_curvature_is_that_of_the_cone_and_of_equal_balls():
    """The closed form is off by 0.06 % of the range from 0.97 to 1.03, and equal balls are as they are."""
    some = RATIOS[[0, 15, 30, 45, 60]]
    found, closed = curvatures(some)
    assert np.abs(closed - found).max() < 1e-3 * np.ptp(found)
    assert closed[2] == pytest.approx(found[2], rel=1e-12)
    assert found[[0, -1]] == pytest.approx([-fitted_curvature(some[0]), fitted_curvature(some[-1])], rel=2e-3)


def test_the_closed_form_is_s_beta_0_over_v_to_first_order():
    """The difference of a small change of the ratio, by hand: beta_0 = change/10 at A_r = 6, v = s r."""
    level, change = 0.2, 1e-6
    slope = (closed_curvature(level, 1 + change) - closed_curvature(level, 1 - change)) / (2 * change)
    speed_falls = -level / 2  # z_0 = r (1 + change/2)
    assert slope == pytest.approx(0.1 / RADIUS + speed_falls, rel=1e-6)


def test_the_ratio_of_a_curvature_is_the_inverse_of_the_closed_form():
    assert closed_curvature(0.3, ratio_of(0.1, 0.3)) == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize(("Gamma", "A_r", "both_stick"), [(0.9, 6.0, False), (1.1, 6.0, False), (0.9, 7.0, True)])
def test_a_tilt_turns_the_heading_and_the_spin_as_the_closed_form_says(Gamma, A_r, both_stick):
    """Least squares over some turns of runs: turning by -turn A, r times the spin by gain A, to 2 %."""
    tilt = 2e-4
    run = simulate(Gamma=Gamma, A_r=A_r, tilt=tilt, periods=1500)
    assert run.orbit.di_end == ("sk_sk" if both_stick else run.orbit.di_end)
    section = run.section()
    heading, spin = section["theta"].values[200:], section["gamma_rate"].values[200:]
    middle = 0.5 * (heading[1:] + heading[:-1])
    across = BASE.g * tilt * np.cos(middle)
    columns = np.column_stack(
        [np.ones_like(middle), 0.5 * (spin[1:] + spin[:-1]), BASE.g * tilt * np.sin(middle), across]
    )
    turns = np.linalg.lstsq(columns, np.diff(heading) * BASE.f)[0][-1]
    gains = np.linalg.lstsq(columns, np.diff(spin) * BASE.f * RADIUS)[0][-1]
    closed = response(run.parameters, both_stick)
    assert turns == pytest.approx(-closed.turn, rel=0.06 if both_stick else 0.02)
    assert gains == pytest.approx(closed.gain, rel=0.02)


def test_the_walk_turns_back_at_the_steeper_tilts_only():
    """One border on the first way up, at 5.41 mrad; the walk in two variables has it within 3 %."""
    tilts = np.array([3e-3, 4.2e-3, 5.0e-3, 5.35e-3, 5.47e-3, 6e-3, 8e-3, 12e-3, 20e-3])
    assert [turns_back(tilt, 1) for tilt in tilts] == (tilts > 5.41e-3).tolist()
    assert [turns_back(tilt, 1, rtol=1e-10) for tilt in (5.35e-3, 5.47e-3)] == [False, True]
    orbit, answer = orbits.find(), response(BASE.given())
    speed = RADIUS * rolled({})
    told = [turned(tilt, 1, 0.0, answer, curvature_of(orbit), speed) for tilt in (5.41e-3 * 0.97, 5.41e-3 * 1.03)]
    assert told == [False, True]


def test_a_walk_without_a_slope_goes_round_and_never_back():
    passed, back = slow_walk(response(BASE.given()), 0.25, 0.8, 0.0, 0.0)
    assert not back
    assert passed == int((0.25 * 0.8 * 400 + 0.5 * pi) / (2 * pi))


def test_tops_are_counted_until_the_spin_changes_sign():
    heading = np.linspace(0, -20, 2001)  # tops at -4.7, -11.0, -17.3
    assert way(heading, np.ones(2001)) == (3, False)
    assert way(heading, np.where(heading > -12, 1.0, -1.0)) == (2, True)


def test_the_walk_is_over_sooner_on_a_steeper_plate():
    assert [comes_to_rest(tilt, 2400) for tilt in (8e-3, 11.4e-3, 11.7e-3, 20e-3)] == [False, False, True, True]


def test_a_dimer_without_spin_is_held_up_to_the_angle_of_friction():
    angle = atan(BASE.mu)
    assert caught(np.array([0.95, 1.05]) * angle, pi / 2, xdot0=0.0).tolist() == [True, False]

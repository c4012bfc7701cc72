"""The next landing: against brute force on random flights, and on cases made to be missed."""

from math import cos, inf, pi, sin, sqrt

import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq

from dimersweep.kernel.flight.free_motion import Flight
from dimersweep.kernel.flight.landing import MAX_LANDING_PROBES
from dimersweep.kernel.model.layout import D1, D2, DIP, N1, N2, N_STATE, PHASE, SPIN, WB, WP
from dimersweep.kernel.model.plate import Sway
from tests.checks.verbs import dimer, first_landing, gap_series, next_landing, take_off

SINE = dimer()  # flights that are made by hand are over a plate without higher harmonics
FEW = 60  # probes that even a hard case should not take


def gaps(fl, sign, t):
    """The gap over an array of times, as it stands."""
    d, n = (fl.d_1, fl.n_1) if sign < 0 else (fl.d_2, fl.n_2)
    x, y = fl.Omega * t, fl.sway.omega * t
    dip = fl.c1 * (1 - np.cos(x)) + fl.c2 * (x - np.sin(x))
    plate = fl.sway.s * (1 - np.cos(y)) + fl.sway.c * (y - np.sin(y))
    return d + n * t - 0.5 * fl.g * t**2 - (fl.h_1 if sign < 0 else fl.h_2) * dip + plate


def made(d=0.0, n=0.0, g=9.81, swing=(0.0, 0.0), Omega=0.0, plate=(0.0, 0.0), omega=100.0, h=0.025):
    """A flight of p1 from its constants; p2 is far away."""
    c1, c2 = swing
    bound = h * Omega**4 * sqrt(c1**2 + c2**2) + omega**4 * sqrt(plate[0] ** 2 + plate[1] ** 2)
    return Flight(d, 1.0, n, 0.0, g, -h, h, Omega, c1, c2, Sway(omega, *plate), bound, 0.0, 1.0, (0.0,) * 3)


def random_flight(rng, k):
    """Off the plate, or just leaving it with one end: slow and fast, spinning, tumbling, on weak and strong plates."""
    dm = dimer(Gamma=rng.uniform(0, 2.5), f=rng.uniform(8, 60), A_r=rng.uniform(2, 9))
    state = np.zeros(N_STATE)
    state[PHASE] = rng.uniform(0, 2 * pi)
    state[DIP] = rng.uniform(0, 0.5) * rng.choice([1, 0.01])
    state[[WB, WP, SPIN]] = rng.normal(size=3) * [10, 10, 200] * rng.choice([0, 0.1, 1, 5])
    state[D1] = rng.choice([0, 1e-9, 1e-4, 0.01])
    state[N1] = abs(rng.normal()) * rng.choice([1e-4, 0.1, 1])
    state[D2] = state[D1] + dm.l * sin(state[DIP])
    state[N2] = state[N1] + dm.l * cos(state[DIP]) * state[WB]
    return dm, take_off(dm, state)


def first_sign_change(fl, sign, until, n=20001):
    """First root after the take-off by brute force, inf if the samples stay positive."""
    t = np.linspace(0, until, n)[1:]
    below = np.flatnonzero(gaps(fl, sign, t) < -1e-16)
    if not below.size:
        return inf
    k = below[0]
    if k == 0:
        return t[0]
    return brentq(lambda s: gaps(fl, sign, s), t[k - 1], t[k], xtol=1e-15)


@pytest.mark.parametrize("seed", range(200))
def test_random_flights_against_brute_force(seed):
    dm, fl = random_flight(np.random.default_rng([1, seed]), seed)
    until = 1.5 * dm.period
    for sign in (-1.0, 1.0):
        t, probes = first_landing(dm, fl, sign, until)
        assert probes < FEW
        expected = first_sign_change(fl, sign, until)
        before = np.linspace(0, min(t, until), 5001)
        assert gaps(fl, sign, before).min() >= -1e-15  # nothing has landed before
        if expected == inf:
            assert t == inf or gaps(fl, sign, t) < 1e-15  # brute force may miss a graze, not the other way round
        else:
            assert t <= expected * (1 + 1e-9) + 1e-15
            assert gap_series(dm, fl, sign, t)[0] == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("seed", range(30))
def test_the_end_that_lands_first(seed):
    dm, fl = random_flight(np.random.default_rng([2, seed]), seed)
    landings = {sign: first_landing(dm, fl, sign, dm.period)[0] for sign in (-1.0, 1.0)}
    sign, t, _ = next_landing(dm, fl, dm.period)
    if min(landings.values()) == inf:
        assert (sign, t) == (0, inf)
    else:
        assert landings[sign] == min(landings.values())
        assert t == pytest.approx(landings[sign], rel=1e-15)


def grazing(miss):
    """A flight whose gap comes down to `miss` at about half its time and then lands later; and the lowest time."""
    shape = {"n": -0.5, "swing": (0.5, 0.2), "Omega": 60.0, "plate": (1e-3, 5e-4)}
    free = made(**shape)
    with mpmath.workdps(40):
        rest = _exact(free)
        samples = np.linspace(0.0, 0.1, 20001)
        values = gaps(free, -1.0, samples)
        low = np.flatnonzero((values[1:-1] < values[:-2]) & (values[1:-1] < values[2:]))[0] + 1
        t_low = mpmath.findroot(lambda t: mpmath.diff(rest, t), samples[low])
        d = float(mpmath.mpf(miss) - rest(t_low))
        return made(d=d, **shape), float(t_low), rest(t_low) + mpmath.mpf(d)


def _exact(fl):
    mp = mpmath.mpf
    n, g, h, Omega, omega = mp(fl.n_1), mp(fl.g), mp(fl.h_2), mp(fl.Omega), mp(fl.sway.omega)
    c1, c2, p_s, p_c = mp(fl.c1), mp(fl.c2), mp(fl.sway.s), mp(fl.sway.c)

    def gap(t):
        x, y = Omega * t, omega * t
        dip = c1 * (1 - mpmath.cos(x)) + c2 * (x - mpmath.sin(x))
        return n * t - g * t**2 / 2 + h * dip + p_s * (1 - mpmath.cos(y)) + p_c * (y - mpmath.sin(y))

    return gap


@pytest.mark.parametrize("miss", [1e-6, 1e-9, 1e-12, 1e-15])
def test_a_graze_that_misses_is_no_landing(miss):
    fl, t_low, low = grazing(miss)
    assert float(low) == pytest.approx(miss, abs=1e-17)
    t, probes = first_landing(SINE, fl, -1.0, 1.0)
    assert t > t_low + 1e-3
    assert t == pytest.approx(first_sign_change(fl, -1.0, 1.0, 200001), rel=1e-12)
    assert probes < FEW


@pytest.mark.parametrize("depth", [1e-6, 1e-9, 1e-12, 1e-15])
def test_a_double_crossing_however_short_is_a_landing(depth):
    fl, t_low, low = grazing(-depth)
    assert float(low) == pytest.approx(-depth, abs=1e-17)
    t, probes = first_landing(SINE, fl, -1.0, 1.0)
    assert t < t_low
    # up to the third derivative, and the gap's own round-off, 1e-17, over the slope at the crossing
    _, _, curve, third = gap_series(SINE, fl, -1.0, t_low)
    half = sqrt(2 * depth / curve)
    assert t_low - t == pytest.approx(half, rel=abs(third) * half / curve, abs=2e-17 / (curve * half))
    assert probes < FEW


@pytest.mark.parametrize("miss", [1e-16, -1e-16])
def test_a_graze_within_round_off_ends_the_search(miss):
    """Either answer is right where the gap is known to 1e-17 only; a later landing, or this one to the square root."""
    fl, t_low, _ = grazing(miss)
    t, probes = first_landing(SINE, fl, -1.0, 1.0)
    assert probes < MAX_LANDING_PROBES
    near = abs(t - t_low) < 1e-8
    assert near or (miss > 0 and t == pytest.approx(first_sign_change(fl, -1.0, 1.0, 200001), rel=1e-12))


@pytest.mark.parametrize("n", [1e-1, 1e-5, 1e-9, 1e-13])
def test_hops_of_any_size(n):
    fl = made(n=n, plate=(-4e-4, 2e-4))
    second, third = -9.81 - 4.0, 200.0
    t, probes = first_landing(SINE, fl, -1.0, 1.0)
    with mpmath.workdps(40):
        exact = mpmath.findroot(lambda s: _exact(fl)(s) / s, 2 * n / 13.81)
    assert gap_series(SINE, fl, -1.0, 0.0)[2:] == (pytest.approx(second), pytest.approx(third))
    assert t == pytest.approx(float(exact), rel=1e-13)
    assert probes < 20


def test_a_hop_is_not_mistaken_for_its_own_start():
    fl = made(d=0.0, n=1e-9)
    assert first_landing(SINE, fl, -1.0, 1.0)[0] == pytest.approx(2e-9 / 9.81, rel=1e-14)


def test_lift_off_at_rate_and_acceleration_zero():
    """The plate turns downward under a ball at rest: the gap opens with the cube of time and lands a good while later."""
    omega = 64.0
    fl = made(g=8.0, plate=(8.0 / omega**2, 1e-3), omega=omega)
    assert gap_series(SINE, fl, -1.0, 0.0) == (0, 0, 0, pytest.approx(1e-3 * omega**3))
    t, probes = first_landing(SINE, fl, -1.0, 1.0)
    expected = first_sign_change(fl, -1.0, 1.0)
    assert expected > 0.01
    assert t == pytest.approx(expected, rel=1e-12)
    assert probes < FEW


def test_an_end_that_stays_down_lands_at_once():
    omega = 64.0
    assert first_landing(SINE, made(g=8.0), -1.0, 1.0)[0] == 0
    assert first_landing(SINE, made(g=8.0, plate=(8.0 / omega**2, -1e-3), omega=omega), -1.0, 1.0)[0] == 0


def test_no_landing_in_a_short_time():
    assert first_landing(SINE, made(n=1.0), -1.0, 0.1) == (inf, 1)
    assert first_landing(SINE, made(n=1.0), -1.0, 0.25)[0] == pytest.approx(2 / 9.81, rel=1e-14)

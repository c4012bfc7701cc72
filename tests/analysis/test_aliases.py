"""Tracks whose times do not tell fast turns from slow ones by themselves: rows, stamps, bursts, pairs of cameras, and few."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dimersweep import fits

PERIOD, RADIUS, ERROR = 36.96, 4.0, 1e-3
FRAMES = np.arange(0, 60, 1 / 30)
TWENTY = np.linspace(0, 50, 20)
BURSTS = np.add.outer([0.0, 1 / 30], np.arange(60.0)).ravel()
KINDS = {"circle": fits.circle, "cycloid": fits.cycloid}


def places(t, period=PERIOD, seed=1, error=ERROR, velocity=0.0):
    rng = np.random.default_rng(seed)
    noise = error * (rng.normal(size=t.size) + 1j * rng.normal(size=t.size))
    return 1 - 2j + velocity * t + RADIUS * np.exp(1j * (0.3 + 2 * np.pi * t / period)) + noise


def fitted(kind, stamps, place, sigma=None):
    return KINDS[kind](stamps, place.real, place.imag, sigma)


def apart(track, name, true):
    """How far a value is from the true one, in its errors."""
    return abs(track.values[name] - true) / track.errors[name]


TIMES = {
    "twice": np.sort(np.r_[FRAMES, FRAMES]),
    "twice with rounding": np.r_[FRAMES, (FRAMES + 0.1) - 0.1],
    "bursts of two": BURSTS,
    "bursts of two a minute": np.add.outer([0.0, 1 / 30], 60 * np.arange(10.0)).ravel(),
    "twenty points twice": np.r_[TWENTY, TWENTY],
    "two cameras 1 ms apart": np.r_[FRAMES, FRAMES + 1e-3],
    "two cameras 0.1 ms apart": np.r_[FRAMES[:300], FRAMES[:300] + 1e-4],
    "three cameras": np.r_[FRAMES[::2], FRAMES[::2], FRAMES[::2] + 2e-4],
    "dropped": FRAMES[np.random.default_rng(4).uniform(size=FRAMES.size) < 0.2],
    "random": np.random.default_rng(5).uniform(0, 60, 80),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("t", TIMES.values(), ids=TIMES)
def test_the_slow_turn_is_found_with_its_errors(kind, t):
    period = PERIOD if kind == "circle" else -PERIOD
    track = fitted(kind, t, places(t, period))
    assert apart(track, "period", PERIOD) < 4 and apart(track, "path_radius", RADIUS) < 4
    assert track.sense == np.sign(period)
    assert track.sigma == pytest.approx(ERROR, rel=0.3)
    assert "places" not in repr(track)  # errors are told as errors


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [0.1, 1.0])
@pytest.mark.parametrize("cut", [np.round, np.floor], ids=["to the nearest", "down"])
def test_rounded_stamps_leave_the_period_as_it_is(kind, step, cut):
    """The mean over a stamp lies nearer to the centre; the error of the radius holds that."""
    track = fitted(kind, step * cut(FRAMES / step + 1e-9), places(FRAMES))
    assert apart(track, "period", PERIOD) < 4
    assert apart(track, "path_radius", RADIUS) < 2
    assert track.errors["path_radius"] < 6e-3 * step
    assert "if times are rounded, the radius is" in repr(track)


@pytest.mark.parametrize("kind", KINDS)
def test_both_balls_in_one_table_have_their_centre(kind):
    """The two lie a rod apart. The errors are those of a track of the centre."""
    t, outward = np.r_[FRAMES, FRAMES], np.exp(1j * (0.3 + 2 * np.pi * FRAMES / PERIOD))
    place = places(t) + 0.012 * np.r_[outward, -outward]
    track = fitted(kind, t, place)
    centre = fitted(kind, FRAMES, 0.5 * (place[: FRAMES.size] + place[FRAMES.size :]))
    assert_allclose(list(track.values.values()), list(centre.values.values()), rtol=1e-9, atol=1e-12)
    assert_allclose(track.covariance, centre.covariance, rtol=1e-3, atol=1e-18)
    assert track.sigma == pytest.approx(ERROR, rel=0.1)
    assert "places of one time differ by 0.024 m" in track.notes[0]
    lost = np.random.default_rng(2).uniform(size=t.size) < np.where(np.arange(t.size) < FRAMES.size, 0, 0.15)
    seldom = fitted(kind, t[~lost], place[~lost])  # the inner ball is lost now and then
    assert apart(seldom, "period", PERIOD) < 4 and apart(seldom, "path_radius", RADIUS) < 4
    assert seldom.sigma == pytest.approx(ERROR, rel=0.1)


def test_copies_of_rows_are_no_more_data():
    t = np.linspace(0, 50, 40)
    once, twice = (fitted("circle", np.tile(t, n), np.tile(places(t), n)) for n in (1, 2))
    assert twice.values == pytest.approx(once.values) and twice.sigma == pytest.approx(once.sigma)
    assert_allclose(twice.covariance, once.covariance)
    given = fitted("circle", np.tile(t, 3), np.tile(places(t), 3), 2e-3)
    assert given.errors == pytest.approx({name: 2e-3 / once.sigma * error for name, error in once.errors.items()})


@pytest.mark.parametrize("times", ["repeated", "as often as it comes"])
def test_deviations_of_repeated_times_are_as_their_errors_say(times):
    """Thirty tracks of two cameras in step, or of one to three rows a time: 60 squared deviations, chi-square: 32 to 99."""
    deviations, sigmas = [], []
    for seed in range(30):
        often = np.full(30, 2) if times == "repeated" else np.random.default_rng(seed).integers(1, 4, 30)
        t = np.repeat(np.linspace(0, 50, 30), often)
        track = fitted("circle", t, places(t, seed=seed))
        deviations += [apart(track, "period", PERIOD), apart(track, "path_radius", RADIUS)]
        sigmas.append(track.sigma)
    assert 32 < np.sum(np.square(deviations)) < 99
    assert np.mean(sigmas) == pytest.approx(ERROR, rel=0.06)


@pytest.mark.parametrize("kind", KINDS)
def test_where_frames_come_once_a_turn_the_other_turns_are_told(kind):
    """Frames every 30 s of a turn of 36.96 s look like one the other way; both can be fitted on."""
    t = np.arange(0, 1200, 30.0)
    track = fitted(kind, t, places(t))
    assert (track.sense, round(track.values["period"], 1)) == (-1, 159.3)
    true = track.others[0]
    assert true.sense == 1 and apart(true, "period", PERIOD) < 4 and apart(true, "path_radius", RADIUS) < 4
    assert true.measured.values[1] == true.values["period"]
    assert "a turn of 4 m in 36.96 s, counterclockwise, fits about as well" in repr(track)


def test_an_alias_too_fast_for_a_dimer_is_none():
    assert fitted("circle", FRAMES, places(FRAMES)).others == ()


def test_uneven_times_tell_a_fast_turn_from_a_slow_one():
    t = 30 * (np.arange(40) + np.random.default_rng(2).uniform(-0.2, 0.2, 40))
    track = fitted("circle", t, places(t))
    assert apart(track, "period", PERIOD) < 4 and track.sense == 1 and track.others == ()


def least_misfit(t, place, rates, moving):
    """The least sum of squares that a circle at one of some rates leaves, by linear least squares."""
    turning = np.exp(1j * np.outer(rates, t))
    even = np.ones_like(turning)
    Q, _ = np.linalg.qr(np.stack([even, turning, *([even * (t - t.mean())] if moving else [])], axis=2))
    fitted = np.einsum("rtk,rk->rt", Q, np.einsum("rtk,t->rk", Q.conj(), place))
    return (np.abs(fitted - place) ** 2).sum(axis=1).min()


@pytest.mark.parametrize("seed", range(6))  # both kinds with the three of times
def test_no_rate_fits_better(seed):
    """All rates up to one and a half turns in the usual step, a twentieth of a turn in the track apart, fit less well."""
    rng = np.random.default_rng([56, seed])
    kind, n = ("circle", "cycloid")[seed % 2], int(rng.integers(8, 60))
    t = [rng.uniform(0, 100, n), np.arange(n) + rng.normal(0, 0.2, n), np.r_[np.arange(n), np.arange(n) + 0.1]][
        seed % 3
    ]
    t, usual, span = t.astype(float), np.median(np.diff(np.unique(t))), np.ptp(t)
    place = places(t, usual * rng.uniform(2, 20) * rng.choice([-1, 1]), seed, 0.1, 0.01 * (kind == "cycloid"))
    track = fitted(kind, t, place)
    rates = 2 * np.pi / span * np.arange(0.05, 1.5 * span / usual, 0.05)
    some = np.array_split(np.concatenate([rates, -rates]), 100)  # a few at a time, for the memory
    least = min(least_misfit(t, place, each, track.moving) for each in some)
    found = track.sense * 2 * np.pi / track.values["period"]
    assert least_misfit(t, place, [found], track.moving) < least * (1 + 1e-9)


def test_a_hundred_thousand_rows_at_random_take_as_many_turns_as_their_times_tell():
    t = np.random.default_rng(7).permutation(np.r_[np.arange(50_000), np.arange(50_000)] / 100)
    track = fitted("circle", t, places(t, 0.05))
    assert apart(track, "period", 0.05) < 4 and track.sense == 1
    assert "a dimer at 503 m/s is too fast: x and y must be in m, t in s" in track.notes[-1]


@pytest.mark.parametrize(("length", "time"), [(1000.0, 1.0), (1.0, 1e-6)], ids=["in mm", "of microseconds"])
def test_sizes_that_no_dimer_has_are_told(length, time):
    place = length * places(FRAMES)
    assert "m/s is too fast: x and y must be in m, t in s" in repr(fitted("circle", time * FRAMES, place))

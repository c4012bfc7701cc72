"""The verdict on a run: against a second one, made of the whole record (``tests.checks.verdicts``)."""

import numpy as np
import pytest

from dimersweep import simulate
from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.compiler.records import record_type
from dimersweep.kernel.model.layout import D1, D2, N1, N2, N_STATE, PERIOD, SPIN
from dimersweep.kernel.verdict import past as pasts
from dimersweep.kernel.verdict import settling
from tests.checks.data import data
from tests.checks.verbs import dimer
from tests.checks.verdicts import LONGEST_PERIOD, WINDOW, Course, verdict

SCENES = data("scenes")["verdicts"]


def numbers_of(run):
    """What a run tells, by name: its own numbers, and those of its orbit."""
    return vars(run) | (vars(run.orbit) if run.orbit else {})


@pytest.mark.jit
@pytest.mark.parametrize("name", SCENES)
def test_the_verdict_is_that_of_the_whole_record(name):
    run = simulate(**SCENES[name], periods=90)
    expected, told = verdict(run), numbers_of(run)
    mode, what = name.split()[:2]
    assert expected["mode"] == mode
    if mode != "drift":
        assert expected["mode_period"] == int(what)
    elif "_" in what:
        assert expected["di_end"] == what.rstrip(",")
    for key, value in expected.items():
        wanted = value if isinstance(value, str) else pytest.approx(value, rel=1e-7, abs=1e-9, nan_ok=True)
        assert told[key] == wanted, key
    assert set(expected) >= {"settled_after", "spin_drift", "down_share_1", "longest_hop_2"}


@pytest.mark.jit
@pytest.mark.parametrize("periods", [26, 31, 60])
def test_the_verdict_on_a_short_run_is_that_of_its_record(periods):
    run = simulate(**SCENES["drift sp_sp, p2"], periods=periods)
    told = numbers_of(run)
    for key, value in verdict(run).items():
        wanted = value if isinstance(value, str) else pytest.approx(value, rel=1e-7, abs=1e-9)
        assert told[key] == wanted, key


# --- when a motion has settled: strobes that are made up ------------------------------------------------------------------


@exported
def follow(dm, states, modes, past, runs):
    """Period boundaries one after the other; for how long they have repeated with each period into `runs`; the period."""
    pasts.begin_past(past)
    for k in range(states.shape[0]):
        settling.note_period(dm, states[k], modes, past)
        for p in range(runs.shape[1]):
            runs[k, p] = past.runs[p]
    p = settling.settled_period(past, False)
    return p if p > 0 else settling.settled_period(past, True)


def followed(x, roll):
    """The kernel's counts and its period for strobes, and those of the `Course`."""
    dm = dimer(r_1=5e-3, r_2=5.2e-3)
    speed = dm.g / dm.omega
    states = np.zeros((len(x), N_STATE))
    states[:, [D1, D2]], states[:, [N1, N2]] = x[:, :2] * speed / dm.omega, x[:, 2:] * speed
    states[:, PERIOD] = 1.0 + np.arange(len(x))
    states[:, SPIN] = roll * speed / dm.p2.r
    runs = np.zeros((len(x), LONGEST_PERIOD + 1))
    period = follow(dm, states, np.zeros(2), np.zeros(1, record_type(pasts.Past))[0], runs)
    course = Course(x, roll)
    return (runs.astype(int), period), (course.runs, course.period())


def steady(n, at=None, step=0.0):
    """Strobes that all are the same but for a step."""
    x = np.full((n, 4), 0.5)
    if at is not None:
        x[at:, 1] += step
    return x


@pytest.mark.parametrize(
    ("at", "step", "lasts"),
    [(12, 0.9e-4, True), (12, 1.1e-4, False), (40, 0.9e-3, True), (40, 1.1e-3, False), (40, -0.9e-3, True)],
)
def test_a_motion_settles_below_one_line_and_stays_settled_below_another(at, step, lasts):
    (runs, _), (expected, _) = followed(steady(60, at, step), np.zeros(60))
    assert (runs == expected).all()
    assert runs[-1, 1] == (59 if lasts else 59 - at)


@pytest.mark.parametrize(("n", "period"), [(WINDOW + 2, 0), (WINDOW + 3, 1)])
def test_a_motion_has_settled_when_it_has_repeated_long_enough(n, period):
    x = steady(n)
    x[0] = 0.6  # the first strobe belongs to what went before
    x[1:, 3] += np.tile([0.0, 0.5e-4], n)[: n - 1]
    assert followed(x, np.zeros(n))[0][1] == period


def drawn(seed):
    """Strobes of a motion of some period whose fast part rings down and whose spin creeps, with a step at a corner."""
    rng, n = np.random.default_rng([36, seed]), 100
    k, p = np.arange(n), int(rng.integers(1, 5))
    pattern = rng.normal(size=(p, 4)) * (0.0 if p == 1 else 10 ** rng.uniform(-4, 0))
    fast = 10 ** rng.uniform(-4, 0) * rng.uniform(0.5, 1.0) ** k * np.cos(rng.uniform(0, np.pi) * k)
    roll = 0.3 + 10 ** rng.uniform(-5, -2) * (k + 10 ** rng.uniform(-4, -2) * k**2)
    family = rng.uniform(-0.9, 0.9, 4)
    x = 1.0 + pattern[k % p] + np.outer(fast, rng.normal(size=4)) + np.outer(roll, family)
    x[int(rng.integers(30, 95)) :] += 10 ** rng.uniform(-5, -2) * rng.normal(size=4)
    return x, roll


@pytest.mark.long_uncompiled
def test_drawn_strobes_settle_as_they_are_said_to():
    periods = []
    for seed in range(50):
        (runs, period), (expected, wanted) = followed(*drawn(seed))
        np.testing.assert_array_equal(runs, expected, err_msg=f"seed {seed}")
        assert period == wanted, f"seed {seed}"
        periods.append(period)
    assert {0, 1, 2, 3, 4} <= set(periods)


def test_the_past_of_a_saved_run_can_be_read_on():
    """Its memory is rows of 24 numbers each, as files have it; which row a part of it begins with."""
    kind = record_type(pasts.Past)
    assert kind.itemsize == 8 * np.prod(pasts.PAST_SHAPE)
    begins = {name: offset // (8 * pasts.PAST_SHAPE[1]) for name, (_, offset, *_) in kind.fields.items()}
    rows = {"off": 0, "runs": 1, "track": 2, "strobes": 3, "doubles": 67, "landings": 131}
    assert {name: begins[name] for name in rows} == rows
    assert pasts.PAST_SHAPE == (195, 24)

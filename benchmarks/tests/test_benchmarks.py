"""The benchmarks at a tiny size: what they time is what they name, and what they conclude follows from what they measure."""

from pathlib import Path

import compare
import memory
import numpy as np
import pytest
import speed
import verbs_loops
from verbs_inputs import DOUBLE, SINGLE, harvest
from verbs_loops import VERBS, Harvest, call

from dimersweep import names, simulate
from dimersweep.kernel.compiler.cache import base_folders
from dimersweep.kernel.model.layout import (
    D1,
    D2,
    DIP,
    N1,
    N2,
)

ROOT = Path(__file__).resolve().parents[2]


pytestmark = pytest.mark.jit
CACHE = base_folders()[0].parent


@pytest.fixture(scope="module")
def found():
    return Harvest(random=3, periods=4)


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_has_inputs_and_answers(found, name):
    verb = VERBS[name](found)
    assert verb.calls(1) > 0
    may_fail = name.startswith("contact step")  # the engine then takes a shorter one
    assert np.isfinite(verb.run(1)).all() or may_fail


@pytest.mark.parametrize(
    ("name", "route"),
    [
        ("single impact, held", verbs_loops.HELD),
        ("single impact, straight slip", verbs_loops.STRAIGHT),
        ("single impact, frictionless", verbs_loops.FRICTIONLESS),
        ("single impact, general", verbs_loops.TURNING),
    ],
)
def test_single_impacts_take_the_route_they_are_named_by(found, name, route):
    assert (call(verbs_loops.ROUTE, VERBS[name](found).inputs) == route).all()


def test_harvested_impacts_are_those_of_the_run():
    run = simulate(periods=3)
    inputs = harvest([run])
    events = run.events
    kind = names(events["kind"]).values
    first = np.append(True, np.diff(events["time"].values) > 0.0)  # of the rows of one impact
    for name, letter in ((DOUBLE, "DI"), (SINGLE, "SI")):
        chosen = first & np.char.startswith(kind, letter)
        expected = np.column_stack([events[f"gap_{i}_rate_before"].values[chosen] for i in (1, 2)])
        if name == SINGLE:  # the first one is the start
            expected = expected[1:]
        states = inputs[name].states
        np.testing.assert_allclose(states[:, [N1, N2]], expected, atol=1e-7)
        shut = states[:, [D1, D2]] == 0.0
        assert shut.all() if name == DOUBLE else (shut.sum(axis=1) == 1).all()
        assert name == SINGLE or (states[:, DIP] == 0.0).all()


def test_chatters_end_closed(found):
    hops = VERBS["chatter"](found).run(1)
    assert (hops >= verbs_loops.CHATTER_HOPS[0]).all()


def test_sign_intervals_hold_the_median_as_often_as_they_say():
    rng = np.random.default_rng(1)
    found = [compare.sign_interval(1.05 * rng.lognormal(0.0, 0.3, 12), 0.05) for _ in range(500)]
    missed = np.mean([not one.low <= 1.05 <= one.high for one in found])
    assert 0.01 < missed < 0.065  # the exact chance is 0.0386
    assert all(one.low <= one.median <= one.high for one in found)


def test_too_few_pairs_are_refused_with_the_number_that_will_do():
    with pytest.raises(SystemExit, match="--pairs 5: too few; must be at least 6"):
        compare.sign_interval(np.ones(5), 0.05)
    compare.sign_interval(np.ones(6), 0.05)


@pytest.mark.parametrize(("factor", "verdict"), [(0.8, "faster"), (1.0, "no difference shown"), (1.25, "slower")])
def test_verdicts(factor, verdict):
    noise = np.resize([0.97, 1.03], (10, 1))
    times = 1e-6 * np.stack([np.ones((10, 1)), factor * noise], axis=2)
    _, line, _ = compare.table(times, ["chatter"])
    assert line.endswith(verdict)


def test_a_pair_of_processes_times_the_same_tree_alike(found, tmp_path):
    inputs = compare.inputs_for(found, ROOT, CACHE, tmp_path)
    timed = compare.timed_pair((ROOT, ROOT), (CACHE, CACHE), (inputs, inputs), ["Delassus", "scene: drift"])
    for (a, b), longest in zip(timed, (1e-4, 1e-1), strict=True):
        assert 1e-10 < a < longest
        assert 0.02 < b / a < 50.0  # whatever else the machine does


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout")
def test_a_revision_is_checked_out_and_leaves_nothing(tmp_path):
    with compare.checked_out("HEAD", tmp_path / "tree") as tree:
        assert (tree / "dimersweep" / "kernel" / "event_loop.py").exists()
    assert not (tmp_path / "tree").exists()
    with pytest.raises(SystemExit, match="no-such"), compare.checked_out("no-such", tmp_path / "tree"):
        pass


def test_compile_times_are_told_over_those_of_the_first_in_the_same_round():
    *_, b, ratio = compare.compile_table(np.array([[10.0, 11.0], [20.0, 24.0], [30.0, 36.0]]))
    assert (b, ratio) == ("B: 24.0 s (11.0 to 36.0)", "B / A: 1.20")


def test_exponent_of_the_growth():
    rtols = 10.0 ** -np.arange(3, 13)
    assert speed.growth(rtols, 3.0 * rtols ** (-1 / 8)) == pytest.approx(-1 / 8)


def test_import_is_quick(tmp_path):
    assert min(speed.fresh(speed.IMPORT, tmp_path).told for _ in range(3)) < 0.3


def test_memory_of_a_point():
    assert memory.bytes_a_point(200, 600, traced=True, to_file=False)[1] < memory.MOST

"""The benchmarks at a tiny size: what they time is what they name, and what they conclude follows from what they measure."""

import os
from pathlib import Path

import compare
import compile_time
import early_stop
import later_course
import memory
import numpy as np
import pytest
import speed
import verbs_loops
from verbs_inputs import DOUBLE, SINGLE, harvest
from verbs_loops import VERBS, Harvest, call

from dimersweep import orbits, simulate
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
    assert np.isfinite(verb.run(1)).all() or name.startswith(
        "contact step"
    )  # a step may fail: the engine takes a shorter one


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
    kind = events["kind"].values
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
    for (a, b), longest in zip(timed, (1e-5, 1e-2), strict=True):
        assert 1e-9 < a < longest
        assert 0.2 < b / a < 5.0


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout")
def test_a_revision_is_checked_out_and_leaves_nothing(tmp_path):
    with compare.checked_out("HEAD", tmp_path / "tree") as tree:
        assert (tree / "dimersweep" / "kernel" / "event_loop.py").exists()
    assert not (tmp_path / "tree").exists()
    with pytest.raises(SystemExit, match="no-such"), compare.checked_out("no-such", tmp_path / "tree"):
        pass


@pytest.mark.parametrize("way", compile_time.WAYS)
def test_every_part_of_the_fast_way_can_be_taken_out(way, tmp_path):
    """Its edit finds the text that it replaces."""
    made = compile_time.make_copy(compile_time.WAYS[way], tmp_path) / "dimersweep"
    kept = ROOT / "dimersweep"
    changed = [file for file in kept.rglob("*.py") if (made / file.relative_to(kept)).read_text() != file.read_text()]
    assert len(changed) == (compile_time.WAYS[way].module != "")


def test_an_edit_that_finds_nothing_is_an_error():
    with pytest.raises(ValueError, match="0 times, not once"):
        compile_time.replaced("a", "b")("x = 2\n")


def test_early_stop_on_a_few_points(capsys):
    kinds = early_stop.main(["--points", "20", "--periods", "60", "--workers", "1"])
    said = capsys.readouterr().out
    assert f"{kinds.total()} of 20 modes differ" in said
    assert "rest: " in said


PASSES_A_BORDER = {
    "e": 0.7433423608556691,
    "Gamma": 0.5879174426469472,
    "f": 10.871068058945365,
    "A_r": 4.258092942455766,
    "mu": 0.18162133214136056,
    "mu_s": 0.28237042799378276,
    "beta0": 1.1040930235653665,
    "xdot0": 1.7378546837487074,
}
ALTERNATES = {
    "e": 0.8391827475082073,
    "Gamma": 1.1072376298475284,
    "f": 14.18583254602025,
    "A_r": 7.83688448173043,
    "mu": 0.08568674004111577,
    "mu_s": 0.15950764035401868,
    "beta0": 0.7738863607370206,
    "xdot0": 1.4379699116089182,
}
STROBED_IN_A_HOP = {
    "e": 0.7047298080489681,
    "Gamma": 0.9713073882590381,
    "f": 25.283508067206412,
    "A_r": 3.361469394358585,
    "mu": 0.13491000631220026,
    "mu_s": 0.17788786106750618,
    "beta0": 1.0562824495239087,
    "xdot0": 2.5666586492250065,
}


def test_a_border_on_the_way_is_foretold():
    """The family of a drift ends where its double impact ends another way; the run goes over to the next family."""
    kind, shown = later_course.why(PASSES_A_BORDER, 1, 72, 400, 1e-8)
    assert kind == later_course.FORETOLD
    before, after = (later_course.beside(PASSES_A_BORDER, [n], 1, 1e-8).seen.orbit.word for n in (320, 350))
    assert before.startswith("DI_sp_sp>DI_sp_sk ") and after.startswith("DI_sp_sp ")
    assert f"the next one found has the word {after}" in shown
    kinds = [simulate(**PASSES_A_BORDER, periods=n).events["kind"].values for n in (320, 350)]
    doubles = [each[np.char.startswith(each, "DI")] for each in kinds]
    assert [each[-1] for each in doubles] == ["DI_sp_sk", "DI_sp_sp"]


def test_a_motion_near_a_shorter_period_is_explained_by_that():
    """Told period 6, it is one of period 3 whose multiplier is -0.997: what alternates lasts up to a change of word."""
    kind, shown = later_course.why(ALTERNATES, 6, 354, 400, 1e-8)
    assert kind == later_course.FORETOLD
    assert "shorter period 3" in shown
    branch = orbits.follow(orbits.find(guess=simulate(**ALTERNATES, periods=330), periods=3), "spin", to=199.0)
    (word,) = branch["spin"].values[branch["special"].values == "word"]
    # where the spin creeps, sections at other phases have the change up to 1e-4 apart (docs/orbits.md)
    assert float(shown.split("at spin ")[1].split()[0]) == pytest.approx(word, rel=1e-4)


def test_a_motion_whose_strobes_lie_in_a_hop_keeps_to_its_family():
    assert later_course.why(STROBED_IN_A_HOP, 1, 291, 400, 1e-8).kind == later_course.KEEPS


@pytest.mark.skipif(not os.environ.get("DIMERSWEEP_SLOW"), reason="minutes: set DIMERSWEEP_SLOW=1")
def test_a_run_that_has_no_family_is_not_explained():
    scene = {"e": 0.6, "Gamma": 2.0, "beta0": np.radians(16)}
    assert simulate(**scene, periods=200).mode == "aperiodic"
    assert later_course.why(scene, 1, 100, 200, 1e-8).kind == later_course.UNEXPLAINED


def test_a_run_that_leaves_where_its_family_has_no_border_is_not_explained(monkeypatch):
    monkeypatch.setattr(later_course, "borders_of", lambda branch: [])
    assert later_course.why(PASSES_A_BORDER, 1, 72, 400, 1e-8).kind == later_course.UNEXPLAINED


def test_a_run_of_another_dimer_is_not_on_the_family():
    first, end = (later_course.beside(STROBED_IN_A_HOP, [n], 1, 1e-8) for n in (291, 400))
    branch = later_course.followed(first, end.seen.orbit.spin)
    other = later_course.beside(STROBED_IN_A_HOP | {"e": STROBED_IN_A_HOP["e"] + 2e-3}, [400], 1, 1e-8)
    assert later_course.leads_to(branch, end)
    assert not later_course.leads_to(branch, other)


def test_exponent_of_the_growth():
    rtols = 10.0 ** -np.arange(3, 13)
    assert speed.growth(rtols, 3.0 * rtols ** (-1 / 8)) == pytest.approx(-1 / 8)


def test_import_is_quick(tmp_path):
    assert min(speed.fresh(speed.IMPORT, tmp_path).told for _ in range(3)) < 0.3


def test_memory_of_a_point():
    assert memory.bytes_a_point(500, 1500, traced=True, to_file=False)[1] < memory.MOST

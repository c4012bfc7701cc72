"""The benchmark of run time against error at a small size, and that its peers run the same model."""

import importlib
import sys

import numpy as np
import pandas as pd
import pareto
import pytest
import report
from programs import Engine, Oracle, Springs

from dimersweep.parameters import Parameters
from tests.checks.scenes import difference
from tests.limits import regular

pytestmark = pytest.mark.jit
DRIFT = Parameters().given()
T = 1.0 / DRIFT["f"]


def test_the_small_benchmark_measures_tells_and_draws(tmp_path, monkeypatch, capsys):
    pytest.importorskip("heyoka")
    monkeypatch.setattr(sys, "argv", ["", "--small", "--figure", str(tmp_path / "pareto.png")])
    pareto.main()
    told = capsys.readouterr().out
    for peer in ("heyoka", "scipy oracle", "Hertz springs"):
        assert f"least advantage over {peer}: " in told
    assert (tmp_path / "pareto.png").stat().st_size > 10_000


def test_heyoka_is_named_where_it_is_not_installed(monkeypatch, capsys):
    monkeypatch.setattr(pareto, "find_spec", lambda name: None)
    assert set(pareto.programs()) == {"engine", "oracle", "springs"}
    assert "heyoka: left out" in capsys.readouterr().out


class Gauged:
    """A program whose error is its setting and whose runs take as long as was set."""

    copies = 1

    def __init__(self, scene, setting):
        self.engine, (self.error, self.taken) = Engine(scene, 1e-13), setting

    def follow(self, times):
        states, doubles = self.engine.follow(times)
        states[:, 0] += 0.01 * self.error
        return states, doubles

    def run(self, end):
        Gauged.clock += self.taken


def test_a_point_is_the_median_error_and_the_time_of_a_period(monkeypatch):
    Gauged.clock = 0.0
    monkeypatch.setattr(pareto.time, "process_time", lambda: Gauged.clock)
    found = {"engine": (Gauged, [(1e-3, 0.25), (1e-5, 0.5)]), "slow": (Gauged, [(9e-5, 1.5)])}
    points, doubts = pareto.measure(["drift"], found, 2, (), 3, 2)
    assert points["seconds"].to_list() == [0.125, 0.25, 0.75]
    np.testing.assert_allclose(points["state"], [1e-3, 1e-5, 9e-5], rtol=1e-6)
    assert (points["double"] == 0).all()
    table = report.advantages(points, doubts, "state")
    # at 1e-4 the engine is half way, in logarithms, from 0.125 to 0.25
    assert table.loc[("drift", "slow"), report.LEVELS[3]] == pytest.approx(0.75 / (0.125 * np.sqrt(2)))


def test_the_advantage_is_told_where_the_reference_is_sure_and_both_reach():
    columns = ("scene", "program", "state", "seconds")
    rows = [
        ("s", "engine", 1e-3, 1.0),
        ("s", "engine", 1e-6, 2.0),
        ("s", "heyoka", 1e-2, 8.0),
        ("s", "heyoka", 1e-4, 9.0),
    ]
    table = report.advantages(pd.DataFrame(rows, columns=columns), {"s": [1e-5, 0.0, 0.0]}, "state")
    np.testing.assert_allclose(table.columns, [1e-1, 1e-2, 1e-3])
    assert table.loc[("s", "heyoka"), report.LEVELS[1]] == pytest.approx(8.0)


def test_time_at_an_error_lies_on_the_front():
    error, seconds = np.array([1e-2, 1e-4, 1e-3, np.nan]), np.array([1.0, 4.0, 9.0, 0.1])
    assert report.time_at(1e-3, error, seconds) == pytest.approx(2.0)  # half way, and the third point is beaten
    assert report.time_at(1.0, error, seconds) == 1.0
    assert np.isnan(report.time_at(1e-5, error, seconds))


def test_the_orbit_follows_from_two_states():
    R, omega, angle, h = 3.0, -0.2, 1.6, 0.025
    t = np.array([0.0, T])
    states = np.zeros((2, 12))
    heading = omega * t + 0.3
    states[:, 3] = heading
    # the centre moves on a circle, `angle` from the axis towards the lateral, which lies at heading - pi/2 from it
    direction = heading + np.pi / 2 - angle
    centre = R * np.column_stack([np.sin(direction), -np.cos(direction)]) * np.sign(omega)
    states[:, :2] = centre - h * np.column_stack([-np.sin(heading), np.cos(heading)])
    assert pareto.orbit_of(states, T, h) == pytest.approx([R, 2 * np.pi / abs(omega), angle], rel=1e-12)


def test_engine_and_oracle_agree_through_the_benchmark():
    times = T * np.array([0.5, 1.0])
    (fine, doubles), (slow, late) = Engine(DRIFT, 1e-10).follow(times), Oracle(DRIFT, 1e-6).follow(times)
    assert difference(fine, slow) < 1e-4
    np.testing.assert_allclose(doubles, late, rtol=0, atol=1e-6 * T)


def test_the_springs_tend_to_the_engine():
    truth, _ = Engine(DRIFT, 1e-10).follow([0.02])
    soft, stiff = (difference(Springs(DRIFT, (k, 20)).follow([0.02])[0], truth) for k in (1e7, 1e10))
    assert stiff < 0.3 * soft


@pytest.mark.parametrize("name", list(pareto.SCENES))
def test_the_peer_on_heyoka_agrees_with_the_engine_at_tight_tolerance(name):
    pytest.importorskip("heyoka")
    from taylor import Heyoka

    scene = Parameters(**pareto.SCENES[name]).given()
    times = np.arange(1, 9) / (2 * scene["f"])
    fine, doubles = Engine(scene, 1e-13).follow(times)
    other, late = Heyoka(scene, 1e-14).follow(times)
    assert difference(fine, other) < 3e-9
    bursts = [each[np.diff(each, prepend=-1.0) > pareto.BURST / scene["f"]] for each in (doubles, late)]
    np.testing.assert_allclose(*bursts, atol=1e-10)


@pytest.mark.parametrize("given", [{"e_2": 0.5}, {"e": 0.0}, {"r_1": 4e-3}])
def test_the_peer_refuses_what_it_does_not_know(given):
    pytest.importorskip("heyoka")
    from taylor import Heyoka

    with pytest.raises(ValueError, match="like ends with e > 0 only"):
        Heyoka(given, 1e-6)


@pytest.mark.parametrize("name", ["drift", "dead run", "no friction"])
def test_the_peer_closes_a_chatter_where_its_hops_would_lead(name, monkeypatch):
    pytest.importorskip("heyoka")
    import taylor

    scene, tol = Parameters(**pareto.SCENES[name]).given(), 1e-9
    times, seen, crossings = np.arange(1, 5) / scene["f"], [], []
    impact, slip_zero, _ = taylor.ACCURACY
    cross = taylor.cross
    monkeypatch.setattr(taylor, "cross", lambda *given: crossings.append(len(seen)) or cross(*given))
    for close in ((4.0, 0.0), (4e-9, 0.0)):  # summed, and followed to hops a thousandth as fast
        monkeypatch.setattr(taylor, "ACCURACY", (impact, slip_zero, close))
        seen.append(taylor.Heyoka(scene, tol).follow(times))
    (states, doubles), (hopped, late) = seen
    assert difference(states, hopped) < 30 * tol
    bursts = [each[np.diff(each, prepend=-1.0) > pareto.BURST / scene["f"]] for each in (doubles, late)]
    np.testing.assert_allclose(*bursts, rtol=0, atol=10 * tol / scene["f"])
    assert 1.3 * crossings.count(0) < crossings.count(1)


def test_the_peer_with_its_own_law_takes_nothing_of_the_engine():
    pytest.importorskip("heyoka")
    for module in (regular, importlib.import_module("law"), importlib.import_module("phases")):
        homes = {getattr(thing, "__module__", "") or "" for thing in vars(module).values()}
        assert not [home for home in homes if home.startswith("dimersweep")]

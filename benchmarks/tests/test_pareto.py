"""The benchmark of run time against error at tiny size, and that its peers run the same model."""

import importlib
import sys
import time

import numpy as np
import pareto
import pareto_report
import pytest
import xarray as xr
from own import Engine, Oracle

from dimersweep.kernel.contact.coordinates import N_PATH, N_Y
from dimersweep.kernel.contact.forces import N_F
from dimersweep.kernel.model.layout import (
    CA,
    CB,
    D2,
    DIP,
    N1,
    N2,
    N_STATE,
    SPIN,
    WB,
    WP,
)
from dimersweep.parameters import Parameters
from tests.checks.scenes import difference

DRIFT = Parameters().given()
T = 1.0 / DRIFT["f"]


def all_scenes():
    return {name: Parameters(**given).given() for name, given in pareto.SCENES.items()}


def test_the_benchmark_measures_keeps_and_draws(tmp_path, monkeypatch, capsys):
    points = pareto.benchmark(["oracle"], ["no friction"], small=True, rounds=2, cap=20.0)
    points.to_netcdf(tmp_path / "pareto.nc")
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "pareto.nc"), "--figure", str(tmp_path / "pareto.png")])
    pareto_report.main()
    told = capsys.readouterr().out
    assert "least advantage over scipy oracle" in told
    assert (tmp_path / "pareto.png").stat().st_size > 10_000
    with xr.open_dataset(tmp_path / "pareto.nc") as kept:
        assert set(kept["program"].values) == {"engine", "oracle"}
        engine = kept.sel(scene="no friction", program="engine").isel(setting=slice(0, 2))
        assert (engine["time"] > 0).all()
        assert (engine["time_low"] <= engine["time"]).all()
        assert (engine["state_error"] < 1e-3).all()
        assert (kept["state_error_doubt"] < 1e-9).all()


def test_a_program_that_is_not_installed_is_named(monkeypatch, capsys):
    monkeypatch.setitem(pareto.METHODS, "heyoka", pareto.METHODS["heyoka"]._replace(module="no_such", needs="no_such"))
    assert set(pareto.available(["engine", "heyoka"])) == {"engine"}
    assert "no_such is not installed" in capsys.readouterr().out


class CompilesAtFirst(Engine):
    """The engine, slow the first time it runs at a setting, as a program that compiles then."""

    copies = 1
    compiled = set()  # noqa: RUF012 (shared on purpose)

    def run(self, end):
        until = time.process_time() + (0.0 if self.rtol in self.compiled else 0.3)
        self.compiled.add(self.rtol)
        while time.process_time() < until:
            pass
        super().run(end)


def test_no_time_has_the_compilation_in_it(monkeypatch):
    monkeypatch.setattr(pareto, "PATIENCE", 0.1)  # what took longer once is not timed again
    found, settings = {"engine": Engine, "late": CompilesAtFirst}, {"engine": [1e-4], "late": [1e-4, 1e-5]}
    Engine(DRIFT, 1e-4).run(T)  # without the JIT or with it: what there is to compile is compiled here
    _, taken, _ = pareto.measure(found, {"drift": DRIFT}, settings, 1, ("drift",), 2, 20.0, 1)
    assert np.isfinite(taken[0, 1]).any(axis=-1).all()
    assert np.nanmedian(taken[0, 1], axis=-1).max() < 0.1


def test_time_at_an_error_lies_on_the_front():
    error, seconds = np.array([1e-2, 1e-4, 1e-3, np.nan]), np.array([1.0, 4.0, 9.0, 0.1])
    assert pareto_report.time_at(1e-3, error, seconds) == pytest.approx(2.0)  # half way, and the third point is beaten
    assert pareto_report.time_at(1.0, error, seconds) == 1.0
    assert np.isnan(pareto_report.time_at(1e-5, error, seconds))


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
    scene = Parameters(mu=0.05, mu_s=0.1).given()
    (fine, doubles), (slow, late) = Engine(scene, 1e-10).follow(times), Oracle(scene, 1e-7).follow(times)
    assert difference(fine, slow) < 1e-5
    np.testing.assert_allclose(doubles, late, atol=1e-6 * T)


@pytest.mark.jit
@pytest.mark.parametrize("name", list(pareto.SCENES))
def test_the_peer_on_heyoka_agrees_with_the_engine_at_tight_tolerance(name):
    pytest.importorskip("heyoka")
    from taylor import Heyoka

    scene = all_scenes()[name]
    times = np.arange(1, 9) / (2 * scene["f"])
    fine, doubles = Engine(scene, 1e-13).follow(times)
    other, late = Heyoka(scene, 1e-14).follow(times)
    assert difference(fine, other) < 3e-9
    bursts = [pareto.first_of_bursts(moments, 1 / scene["f"]) for moments in (doubles, late)]
    np.testing.assert_allclose(*bursts, atol=1e-10)


@pytest.mark.jit
def test_the_peer_with_its_own_law_takes_nothing_of_the_engines_but_its_numbering():
    pytest.importorskip("heyoka")
    for name in ("passage", "blow", "forces", "chatter", "law", "phases"):
        module = importlib.import_module(name)
        homes = {getattr(thing, "__module__", "") or "" for thing in vars(module).values()}
        assert not [home for home in homes if home.startswith("dimersweep")]


@pytest.mark.jit
def test_the_impacts_of_the_peer_are_those_of_the_engine():
    import blow
    import law
    import passage

    from tests.checks.verbs import collide_double, collide_single, dimer, scratch

    rng, accuracy = np.random.default_rng(1), law.Accuracy(1e-13, 1e-13, 0.0, 0.0)
    for mu, mu_s in ((0.2, 0.4), (0.05, 0.1), (0.5, 0.6), (0.0, 0.0)):
        for trial in range(40):
            scene = {"mu": mu, "mu_s": mu_s, "e": rng.uniform(0.2, 0.9), "A_r": rng.uniform(3, 8)}
            body, dm, (work, log) = passage.body_of(scene), dimer(**scene), scratch()
            double = trial % 2 == 0
            state = np.zeros(N_STATE)
            state[DIP] = 0.0 if double else rng.uniform(0.05, 0.6)
            state[N1], state[N2] = (rng.choice([0, 0.2, -0.3]), -0.5) if double else (-0.4, rng.normal())
            state[D2] = 2 * body.h * np.sin(state[DIP])
            state[WB] = (state[N2] - state[N1]) / (2 * body.h * np.cos(state[DIP]))
            state[WP], state[SPIN], state[CA], state[CB] = rng.normal(size=4) * [5, 50, 0.3, 0.3]
            if trial % 4 > 1:  # the end that the other one is beside slips laterally only, or not at all
                state[CA] = -body.r * state[WB]
                state[CB] = body.r * state[SPIN] - body.h * state[WP]
            own, engine = state.copy(), state.copy()
            if double:
                status = law.collide_both(body, own, accuracy, np.zeros(blow.DESK))
                collide_double(dm, engine, 0.5, 1e-12, np.zeros(2), work, log)
            else:
                status = law.collide_one(body, own, 0, accuracy, np.zeros(blow.DESK))
                collide_single(dm, engine, -1.0, 0.4, 1e-12, work, log)
            assert status == blow.DONE
            scale = np.array([1, 1, body.h, body.h, body.r, 1, 1])
            moved = [N1, N2, WB, WP, SPIN, CA, CB]
            np.testing.assert_allclose(scale * own[moved], scale * engine[moved], rtol=0, atol=2e-9, err_msg=str(scene))


@pytest.mark.jit
@pytest.mark.parametrize("name", ["drift", "dead run", "no friction"])
def test_the_peer_closes_a_chatter_where_its_hops_would_lead(name, monkeypatch):
    pytest.importorskip("heyoka")
    import taylor

    scene = all_scenes()[name]
    times, tol = np.arange(1, 5) / scene["f"], 1e-9
    impact, slip_zero, _, _ = taylor.ACCURACY
    seen, crossings = [], []
    for close, v_rest in (((4.0, 0.0), (0.0, 1e-14)), ((0.0, 0.0), (0.0, 1e-13))):
        monkeypatch.setattr(taylor, "ACCURACY", (impact, slip_zero, close, v_rest))
        peer = taylor.Heyoka(scene, tol)
        seen.append(peer.follow(times))
        counted, cross = [], peer.bare._cross
        peer.bare._cross = lambda *rest, cross=cross, counted=counted: counted.append(cross(*rest))
        peer.run(times[-1])
        crossings.append(len(counted))
    (states, doubles), (hopped, late) = seen
    assert difference(states, hopped) < 30 * tol
    bursts = [pareto.first_of_bursts(moments, 1 / scene["f"]) for moments in (doubles, late)]
    np.testing.assert_allclose(*bursts, rtol=0, atol=10 * tol / scene["f"])
    assert 2 * crossings[0] < crossings[1]


@pytest.mark.jit
def test_the_equations_on_heyoka_are_those_of_the_kernel():
    hy = pytest.importorskip("heyoka")
    import phases

    from tests.checks.verbs import contact_rates, dimer

    dm = dimer(**DRIFT)
    y = np.zeros(N_Y)
    y[:N_PATH] = 0.3, 2.0, -1.5, 40.0, 0.02, -0.3, 0.7, 0.01, 0.1, 0.2, 0.3
    flat = y.copy()
    flat[:2] = 0.0
    pars = [0.4, 1.0, 1e-9, 1.0, dm.p2.h, dm.p1.r, dm.m * dm.it, dm.m * dm.ia, dm.p1.mu, dm.p1.mu_s, dm.g]
    pars += [dm.A_z * dm.omega**2, dm.omega]
    for modes in ([1, 0], [0, 1], [2, 0], [0, 2], [1, 2], [2, 1], [1, 1], [2, 2]):
        state = np.where(np.array(modes).all(), flat, y)
        if 1 in modes:
            state[4] = 0.0
        if modes[0] == 1 or modes == [0, 1]:
            state[5] = 0.0
        if modes == [1, 1]:
            state[2] = 0.0
        if modes == [1, 2]:
            pars[1] = np.sign(state[5] - dm.l * state[2])
        if modes == [2, 1]:
            state[2] = state[5] / (dm.l)
            pars[1] = np.sign(state[5])
        dy, F = np.zeros(N_Y), np.zeros(N_F)
        contact_rates(dm, np.array(modes, float), 0.4 + dm.omega * state[7], state, dy, F)
        phase = phases.equations(*modes)
        functions = [*(rate for _, rate in phase.rates), hy.par[len(pars) - 1]]  # the last parameter: all are expected
        rates = hy.cfunc(functions, [name for name, _ in phase.rates])
        scaled = np.where(np.isin(np.arange(N_PATH), [3, 10]), dm.p1.r * state[:N_PATH], state[:N_PATH])
        found = rates(scaled, pars=pars)[:-1]
        found /= found[7] * np.where(np.isin(np.arange(N_PATH), [3, 10]), dm.p1.r, 1.0)  # per time, in SI
        np.testing.assert_allclose(found, dy[:N_PATH], rtol=1e-12, atol=1e-12, err_msg=str(modes))


def test_the_springs_tend_to_the_engine():
    from springs import Spring, Springs

    times = [0.02]
    truth, _ = Engine(DRIFT, 1e-10).follow(times)
    soft, stiff = (difference(Springs(DRIFT, Spring(k, 20)).follow(times)[0], truth) for k in (1e7, 1e10))
    assert stiff < 0.3 * soft

"""The parameters that may be left out: a plate with a second harmonic, and a coefficient for lasting contacts."""

from math import isfinite

import numpy as np
import pytest

import dimersweep
from dimersweep import simulate
from dimersweep.kernel.model.layout import ROW
from dimersweep.parameters import Parameters, value_of
from dimersweep.studies.sweep import study_of
from dimersweep.symbols import BASE, ENDS, LEFT_OUT, PARAMETERS, Quantity, conditions, parameter_shown, stated, symbol
from tests.checks.data import data

jit = pytest.mark.jit


def test_every_parameter_has_a_value_where_it_is_left_out():
    assert set(BASE) | set(LEFT_OUT) == set(PARAMETERS)
    assert set(ROW) == set(PARAMETERS) - set(ENDS)  # a row has the values of both ends
    for name in LEFT_OUT:
        assert isfinite(value_of(name, BASE)), name


def test_rows():
    row = dict(zip(ROW, Parameters(mu_s=0.7).row(), strict=True))
    assert (row["Gamma_2"], row["phi_2"], row["mu_h_1"], row["mu_h_2"]) == (0.0, 0.0, 0.7, 0.7)
    row = dict(zip(ROW, Parameters(Gamma_2=0.3, phi_2=-1.0, mu_h=0.25).row(), strict=True))
    assert (row["Gamma_2"], row["phi_2"], row["mu_h_1"], row["mu_s_2"]) == (0.3, -1.0, 0.25, 0.4)
    row = dict(zip(ROW, Parameters(mu_s_1=0.7, r_2=6e-3).row(), strict=True))
    assert (row["mu_h_1"], row["mu_h_2"], row["r_1"], row["k_ratio"]) == (0.7, 0.4, 5e-3, 1.2**0.5)


def test_what_is_left_out_or_zero_is_not_told():
    assert set(Parameters().given()) == set(BASE)
    assert set(Parameters(Gamma_2=0.0, phi_2=0).given()) == set(BASE)
    assert set(Parameters(mu_h=0.4, Gamma_2=0.1).given()) == {*BASE, "mu_h", "Gamma_2"}


def test_the_configuration_of_a_sweep_without_them_does_not_name_them():
    told = study_of({"Gamma": [0.5, 0.9]}, periods=10).configuration()
    assert set(told["fixed"]) == set(BASE) - {"Gamma"}
    told = study_of({"mu_h": [0.2, 0.4]}, {"Gamma_2": 0.3}, periods=10).configuration()
    assert set(told["fixed"]) == {*BASE, "Gamma_2"}


@pytest.mark.parametrize(
    ("values", "varied", "told"),
    [
        ({}, (), {"e": 0.6}),
        ({"e_1": 0.5}, (), {"e_1": 0.5, "e_2": 0.6}),
        ({"e_1": 0.5, "e_2": 0.5}, (), {"e": 0.5}),
        ({"e_1": 0.5, "e_2": 0.7}, (), {"e_1": 0.5, "e_2": 0.7}),
        ({"e_1": 0.5}, ("e",), {"e_1": 0.5}),
        ({}, ("e_1",), {"e_2": 0.6}),
        ({"e_2": 0.7}, ("e_1",), {"e_2": 0.7}),
        ({}, ("e", "e_2"), {}),
    ],
)
def test_unlike_ends_are_stated_each_and_like_ones_at_once(values, varied, told):
    held = stated(BASE | values, varied)
    assert {name: held[name] for name in ("e", "e_1", "e_2") if name in held} == told
    text = conditions(BASE | values, varied)
    for name in ("e", "e_1", "e_2"):
        assert (f"{name}\N{NO-BREAK SPACE}=" in text) == (name in told)


@pytest.mark.parametrize("name", [name for name in PARAMETERS if name not in ("e", "e_1", "e_2")])
def test_conditions_name_each_parameter_that_is_not_the_base_case_s(name):
    other = 1.25 * BASE[name] if BASE.get(name) else 0.3
    for tex in (False, True):
        told = parameter_shown(name, other, tex=tex).replace(" ", "\N{NO-BREAK SPACE}")
        assert told in conditions(BASE | {name: other}, always=(), tex=tex).split(", ")
        assert told not in conditions(BASE | {name: other}, (name,), tex=tex)
    assert conditions(BASE, always=()) == ""
    assert conditions(BASE | {"mu_h": BASE["mu_s"], "Gamma_2": 0.0}, always=()) == ""


def test_a_parameter_with_ends_is_stated_by_the_tables_alone(monkeypatch):
    for end in "12":
        monkeypatch.setitem(PARAMETERS, f"mu_s_{end}", Quantity("1", ""))
        monkeypatch.setitem(LEFT_OUT, f"mu_s_{end}", "mu_s")
    monkeypatch.setitem(ENDS, "mu_s", ("mu_s_1", "mu_s_2"))
    told = conditions(BASE | {"mu_s_2": 0.3}, always=()).replace("\N{NO-BREAK SPACE}", " ")
    assert told == "μ_s_1 = 0.4, μ_s_2 = 0.3"
    assert symbol("mu_s_1", tex=True) == r"$\mu_{s,1}$"


def arrays(run, periods):
    """Every number of a run, as bytes."""
    states = run.states(np.linspace(0.0, periods / run.parameters["f"], 301))
    told = [repr((run.mode, run.n_events, run.orbit, run.down_share_1, run.settled_after))]
    return told + [data[name].values.tobytes() for data in (run.events, states) for name in data.data_vars]


@jit
@pytest.mark.parametrize("scene", data("scenes")["optional"]["scenes"])
def test_nothing_changes_where_they_say_nothing_new(scene):
    """No second harmonic, whatever its phase, and lasting contacts held as impacts are: the same bits."""
    same = {"Gamma_2": 0.0, "phi_2": 1.0, "mu_h": scene.get("mu_s", BASE["mu_s"])}
    assert arrays(simulate(**scene, **same, periods=30), 30) == arrays(simulate(**scene, periods=30), 30)


@jit
def test_a_second_harmonic_alone_is_a_plate_of_twice_the_frequency():
    """Gamma = 0: the run at 2 f, period by period, up to rounding."""
    shaken = {"Gamma": 0.0, "f": 10.0, "Gamma_2": 0.9, "phi_2": 0.7}
    times = np.linspace(0.0, 0.4, 41)
    twice = simulate(**shaken, periods=4, rtol=1e-12).states(times)
    plain = simulate(Gamma=0.9, f=20.0, phi0=0.7, periods=8, rtol=1e-12).states(times)
    for name in ("x1", "y1", "z1", "theta", "beta", "gap_1", "gap_2", "plate", "z1_rate", "beta_rate"):
        np.testing.assert_allclose(twice[name], plain[name], rtol=0, atol=1e-7)


@jit
def test_shadows_of_a_run_bound_its_error_with_both():
    scene = {"Gamma_2": 0.4, "phi_2": 2.0, "mu_h": 0.25, "beta0": 0.2}
    run = simulate(**scene, periods=5, rtol=1e-8)
    finer = simulate(**scene, periods=5, rtol=1e-12)
    times = np.linspace(0.0, 5 / 15, 21)
    bound = run.error(times)["gap_2"].sel(time=times, method="nearest")
    assert (np.abs(run.states(times)["gap_2"].values - finer.states(times)["gap_2"].values) <= bound.values).all()


@jit
def test_they_are_axes_like_any_other():
    axes = {"Gamma_2": [0.0, 0.2], "mu_h": [0.2, 0.3, 0.4], "phi_2": [0.0, 1.0]}
    cube = dimersweep.sweep(axes, periods=60, workers=1, progress=False)
    assert cube["mode"].dims == tuple(axes)
    assert cube["mu_h"].attrs["units"] == "1" and cube["phi_2"].attrs["units"] == "rad"
    plain = dimersweep.sweep({"xdot0": [1.0]}, periods=60, workers=1, progress=False)
    same = cube.sel(Gamma_2=0.0, mu_h=0.4)
    for name in ("mode", "n_events", "radius", "zeta"):
        np.testing.assert_array_equal(same[name].values, np.repeat(plain[name].values, 2))
    assert cube["n_events"].sel(Gamma_2=0.2).values.min() > 0
    assert not np.array_equal(cube["n_events"].sel(mu_h=0.2), cube["n_events"].sel(mu_h=0.4))


@jit
def test_held_by_mu_in_lasting_contact_the_end_that_is_down_slips_more():
    """With mu_h = mu p1 slips for most of a cycle of the drift, with mu_h = mu_s it rolls for most of it."""
    shares = {}
    for mu_h in (0.2, 0.4):
        run = simulate(mu_h=mu_h, periods=300)
        assert run.mode == "drift"
        late = run.states((280 + np.linspace(0.0, 10.0, 4001)) / 15)
        shares[mu_h] = float((late["contact_state"] == 10).mean())  # SC_sp of p1
    assert shares[0.2] > 0.8 and shares[0.4] < 0.35

"""Input is checked in one place; each refusal is one line with the parameter, the value and what is allowed."""

import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from dimersweep.cubes.grid import make_grid, make_points
from dimersweep.errors import ParameterError
from dimersweep.kernel.model.layout import ROW, WAVES
from dimersweep.parameters import Parameters, Rule, bounds, check, keeps_rules, updated


def test_limits_belong_to_the_allowed_range():
    Parameters(e=0, mu=0, mu_s=0, A_r=2, Gamma=0, beta0=0, rho_r=0, D_r=0)
    Parameters(e=1, D_r=0.01, mu=0.4)


def test_row_is_in_the_order_of_the_kernel():
    row = Parameters(e=0.5, e_2=0.7, Gamma=1.1).row()
    assert row.dtype == np.float64
    named = dict(zip(ROW, row, strict=True))
    assert (named["e_1"], named["e_2"], named["Gamma"], named["g"]) == (0.5, 0.7, 1.1, 9.81)


@pytest.mark.parametrize(
    ("parameters", "ends"),
    [
        ({}, (0.6, 0.6)),
        ({"e": 0.7}, (0.7, 0.7)),
        ({"e_1": 0.5}, (0.5, 0.6)),
        ({"e": 0.7, "e_1": 0.5}, (0.5, 0.7)),
        ({"e": 0.7, "e_2": 0.5}, (0.7, 0.5)),
        ({"e_1": 0.5, "e_2": 0.4}, (0.5, 0.4)),
    ],
)
def test_a_parameter_is_that_of_both_ends_unless_one_has_its_own(parameters, ends):
    made = Parameters(**parameters)
    assert dict(zip(ROW, made.row(), strict=True)).items() >= {"e_1": ends[0], "e_2": ends[1]}.items()
    for again in (Parameters(**made.given()), replace(made, Gamma=made.Gamma)):
        assert again == made
    assert ("e" in made.given()) == (len(set(parameters) - {"e"}) < 2)


@given(st.dictionaries(st.sampled_from(["e", "e_1", "e_2"]), st.sampled_from([0.3, 0.5, 0.6]), min_size=1), st.data())
def test_runs_axes_fixed_values_and_points_have_one_rule_for_the_ends(values, data):
    varied = data.draw(st.sets(st.sampled_from(sorted(values)), min_size=1))
    axes, fixed = {name: [values[name]] for name in varied}, {n: v for n, v in values.items() if n not in varied}
    checked = {
        "run": lambda: Parameters(**values).row(),
        "grid": lambda: make_grid(axes, fixed).rows_at(np.arange(1))[0],
        "points": lambda: make_points(axes, fixed).rows_at(np.arange(1))[0],
        "fixed": lambda: make_grid({"f": [15.0]}, values).rows_at(np.arange(1))[0],
    }
    if len(values) == 3:
        for row in checked.values():
            with pytest.raises(ParameterError, match=r"^e: has no effect beside e_1 and e_2"):
                row()
        return
    ends = [values.get(end, values.get("e", 0.6)) for end in ("e_1", "e_2")]
    for row in checked.values():
        assert row()[:2].tolist() == ends


def test_the_distance_of_the_balls_stands_for_the_aspect_ratio():
    assert Parameters(l=0.05) == Parameters(A_r=6.0)
    made = Parameters(l="0.05 m", r=4e-3)
    assert (made.A_r, made.given()["A_r"], "l" in made.given()) == (7.25, 7.25, False)
    assert replace(made, Gamma=1.0).A_r == 7.25
    assert updated({"A_r": 6.0, "r": 4e-3}, {"l": 0.05}) == {"r": 4e-3, "A_r": 7.25}
    with pytest.raises(
        ParameterError, match=r"^l: is for single runs and fixed values \(distance between the centres .*\); give A_r$"
    ):
        make_grid({"l": [0.05, 0.06]})


def test_amplitude_and_velocity_of_the_plate_stand_for_the_intensity():
    omega = 2 * np.pi * 20
    made = Parameters(A_z="1.5 mm", f=20)
    assert made.Gamma == pytest.approx(1.5e-3 * omega**2 / 9.81, rel=1e-15)
    assert Parameters(v_z="150 mm/s", f=20, g=1.6).Gamma == pytest.approx(0.15 * omega / 1.6, rel=1e-15)
    assert updated({"f": 20.0, "Gamma": 3.0}, {"A_z": 1.5e-3}) == {"f": 20.0, "Gamma": made.Gamma}
    assert make_grid({"e": [0.6]}, {"A_z": 1.5e-3, "f": 20}).fixed["Gamma"] == made.Gamma


def test_harmonics_are_their_short_forms():
    waves = {"z": {1: (0.9, 0.1), 2: (0.02, "30 deg")}, "x": {1: (0.1, 0.2), 16: (0.01, 3.0)}}
    short = {"Gamma": 0.9, "phi0": 0.1, "Gamma_2": 0.02, "phi_2": "30 deg"}
    along = {"Gamma_x": 0.1, "phi_x": 0.2, "Gamma_x_16": 0.01, "phi_x_16": 3.0}
    assert Parameters(harmonics=waves) == Parameters(**short, **along)
    known = {"Gamma": 0.9, "Gamma_2": 0.3, "phi_2": 1.0, "Gamma_y": 0.2, "phi_y": 0.1}
    assert updated(known, {"harmonics": {"z": {3: (0.1, 0.2)}}}) == {
        **dict.fromkeys((Gamma for Gamma, _ in WAVES[0]), 0.0),
        "Gamma_3": 0.1,
        "phi_3": 0.2,
        "phi_2": 1.0,
        "Gamma_y": 0.2,
        "phi_y": 0.1,
    }


@pytest.mark.parametrize("text", ["16 deg", "16deg", "16 degrees", "16 degree", "16°"])
def test_an_angle_may_be_in_degrees(text):
    assert Parameters(beta0=text).beta0 == pytest.approx(np.deg2rad(16), rel=1e-15)
    assert make_grid({"f": [15]}, {"beta0": {"value": 16, "unit": text[2:].strip()}}).fixed["beta0"] == pytest.approx(
        np.deg2rad(16), rel=1e-15
    )
    made = make_grid({"beta0": {"start": 8, "stop": 16, "step": 4, "unit": text[2:].strip()}})
    np.testing.assert_array_equal(made.axes["beta0"], np.deg2rad([8, 12, 16]))


@pytest.mark.parametrize(
    ("known", "given_ones", "expected"),
    [
        ({"e": 0.6}, {"e_1": 0.5}, {"e": 0.6, "e_1": 0.5}),
        ({"e": 0.6}, {"e_1": 0.5, "e_2": 0.4}, {"e_1": 0.5, "e_2": 0.4}),
        ({"e": 0.6, "e_1": 0.5}, {"e_2": 0.4}, {"e_1": 0.5, "e_2": 0.4}),
        ({"e_1": 0.5, "e_2": 0.4}, {"e": 0.7}, {"e": 0.7}),
        ({"e_1": 0.5, "e_2": 0.4}, {"e": 0.7, "e_1": 0.3}, {"e": 0.7, "e_1": 0.3}),
        ({"e_1": 0.5, "e_2": 0.4}, {"e_1": 0.3}, {"e_1": 0.3, "e_2": 0.4}),
        ({"e": 0.6, "e_1": 0.5, "e_2": 0.4}, {}, {"e_1": 0.5, "e_2": 0.4}),
    ],
)
def test_what_is_given_takes_the_place_of_what_was_known_at_that_end(known, given_ones, expected):
    assert updated(known, given_ones) == expected


def test_rules_between_two_parameters_are_judged_end_by_end(monkeypatch):
    """With a friction of its own for each end: the rules are those of the table, whatever parameter it is."""
    monkeypatch.setattr("dimersweep.parameters.ENDS", {"mu": ("mu_1", "mu_2"), "mu_s": ("mu_s_1", "mu_s_2")})
    check({"mu_1": 0.3, "mu": 0.1, "mu_s_2": 0.2, "mu_s": 0.4})
    with pytest.raises(ParameterError, match=r"^mu_s = 0.4: must be >= mu_1 = 0.5 "):
        check({"mu_1": 0.5, "mu": 0.1, "mu_s": 0.4})
    with pytest.raises(ParameterError, match=r"^mu_2 = -0.1: must be >= 0$"):
        check({"mu_2": -0.1, "mu": 0.1})


@pytest.mark.parametrize("value", [np.float32(20), np.int64(20), 20, np.array(20.0), xr.DataArray(20.0)])
def test_numbers_of_any_kind_are_taken(value):
    assert type(Parameters(f=value).f) is float


@given(st.dictionaries(st.sampled_from(ROW), st.floats(allow_nan=True, allow_infinity=True), max_size=4))
def test_any_floats_give_a_finite_row_or_a_refusal_of_one_line(values):
    try:
        row = Parameters(**values).row()
    except ParameterError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(row).all()


tied = st.lists(st.floats(0.01, 1), min_size=1, max_size=4).map(np.array)


@given(tied, tied, tied, tied)
def test_columns_are_judged_as_all_their_combinations_are(mu, mu_s, D_r, r):
    columns = {"mu": mu, "mu_s": mu_s, "D_r": D_r, "r": r}
    combined = dict(zip(columns, map(np.ravel, np.meshgrid(*columns.values())), strict=True))
    try:
        check(columns)
    except ParameterError as error:
        assert not keeps_rules(combined).all()
        found = re.match(r"(\w+) = (\S+): must be [<>]= .*?= ([^ ]+) \(", str(error))
        broken = {found[1]: float(found[2]), {"mu_s": "mu", "mu_h": "mu", "D_r": "r"}[found[1]]: float(found[3])}
        assert not keeps_rules(broken)
    else:
        assert keeps_rules(combined).all()


def test_a_grid_of_1e9_points_is_judged_by_its_axes(monkeypatch):
    checked, holds = [], Rule.holds

    def counting(rule, values, other=1.0):
        checked.append(np.size(values) + np.size(other))
        return holds(rule, values, other)

    monkeypatch.setattr(Rule, "holds", counting)
    axes = {"mu": np.linspace(0.1, 0.3, 31_700), "mu_s": np.linspace(0.3, 0.9, 31_700)}
    tracemalloc.start()
    try:
        assert make_grid(axes).size > 1e9
        with pytest.raises(ParameterError, match=r"^mu_s = 0.2: must be >= mu = 0.200003"):
            make_grid(axes | {"mu_s": np.linspace(0.2, 0.9, 31_700)})
        assert 31_700 < sum(checked) < 10 * 31_700
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "given", "known"),
    [
        ("e", {}, (0, 1)),
        ("mu", {}, (0, 0.4)),
        ("mu_s_1", {"mu_s_1": 0.6, "mu_s_2": 0.5}, (0.2, np.inf)),
        ("phi0", {}, (-np.inf, np.inf)),
    ],
)
def test_the_bounds_of_a_parameter_beside_the_others_are_those_of_its_rules(name, given, known):
    values = Parameters(**({"mu": 0.2, "mu_s": 0.4} if name != "mu_s_1" else {"mu": 0.2}) | given).given()
    found = bounds(name, values)
    for value, bound in zip(found, known, strict=True):
        assert value == pytest.approx(bound, abs=1e-14)
        check(values | {name: value})

"""Every number that comes out lies in the range that its documentation states (`symbols`)."""

from math import inf, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dimersweep
from dimersweep.cubes.cube import FLAGS, build, names
from dimersweep.cubes.grid import make_grid
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import CODES, N_CODES, N_OUT, OUT
from dimersweep.parameters import Parameters
from dimersweep.symbols import EVENT_QUANTITIES, PARAMETERS, QUANTITIES, STATE_QUANTITIES

pytestmark = pytest.mark.jit
steady = settings(derandomize=True, max_examples=40, deadline=None)


def between(low, high):
    return st.integers(0, 2000).map(lambda k: low + (high - low) * k / 2000)


scenes = st.builds(
    dict,
    e=between(0.0, 0.9),
    Gamma=between(0.4, 3.0),
    f=between(8.0, 40.0),
    A_r=between(2.0, 8.0),
    mu=st.sampled_from([0.0, 0.05, 0.2]),
    beta0=between(0.0, 1.55),
    xdot0=between(-1.0, 1.0),
    phi0=between(0.0, 6.0),
)


def in_range(name, values, quantity):
    known = np.asarray(values, dtype=float)
    known = known[~np.isnan(known)]
    outside = known[(known < quantity.least) | (known > quantity.most)]
    assert outside.size == 0, (name, outside, quantity)


@steady
@given(scenes, st.integers(1, 120), st.booleans())
def test_outcomes_are_in_their_ranges(scene, periods, stop):
    out, codes = np.full((1, N_OUT), np.nan), np.zeros((1, N_CODES), dtype=np.int64)
    run_many(Parameters(**scene).row()[None], periods, 1e-8, stop, out, codes)
    for name, values in (*zip(OUT, out.T, strict=True), *zip(CODES, codes.T, strict=True)):
        in_range(name, values, QUANTITIES[name])
        if name in FLAGS:
            assert 0 <= values[0] < len(FLAGS[name])


@steady
@given(scenes, st.integers(1, 12))
def test_what_is_recorded_is_in_its_range(scene, periods):
    run = dimersweep.simulate(**scene, periods=periods)
    for name, quantity in EVENT_QUANTITIES.items():
        if run.events[name].dtype.kind == "f":
            in_range(name, run.events[name], quantity)
    states = run.states(np.linspace(0, run.n_periods / scene["f"], 50))
    for name, quantity in STATE_QUANTITIES.items():
        in_range(name, states[name], quantity)


@pytest.mark.parametrize("record", [True, False])
def test_a_rest_that_is_told_early_has_shares_of_what_was_run(record):
    """A rest that is known before all periods asked for are made has the shares of those: both ends are down."""
    run = dimersweep.simulate(Gamma=0.9, f=25, beta0=np.radians(88), periods=200, stop_when_settled=True, record=record)
    assert run.mode == "rest"
    assert run.n_periods < 200 - 12
    assert (run.down_share_1, run.down_share_2) == (1.0, 1.0)


def test_a_flight_that_goes_on_at_the_end_counts_as_long():
    # thrown up by hard shaking, both ends fly over many periods: the last 12 are mostly flight
    run = dimersweep.simulate(Gamma=8.0, f=40, e=0.9, periods=60)
    assert 0 <= run.down_share_1 < 0.2
    assert 0 <= run.down_share_2 < 0.2


def test_ranges_are_stated_where_there_is_one():
    for name in ("zeta", "impact_phase", "down_share_1", "down_share_2"):
        assert -inf < QUANTITIES[name].least < QUANTITIES[name].most < inf
    assert (STATE_QUANTITIES["beta"].least, STATE_QUANTITIES["beta"].most) == (-pi / 2, pi / 2)
    assert {*OUT, *CODES} <= set(QUANTITIES)


def test_a_cube_tells_the_ranges():
    cube = build(make_grid({"f": [15, 20]}), np.full((2, N_OUT), np.nan), np.zeros((2, N_CODES), dtype=np.int64), {})
    assert cube["down_share_1"].attrs["valid_max"] == 1
    assert cube["n_events"].attrs["valid_min"].dtype == cube["n_events"].dtype
    assert "valid_min" not in cube["precession_rate"].attrs
    assert names(cube["mode"]).values.tolist() == ["not_run", "not_run"]
    assert "valid_min" not in cube["f"].attrs and PARAMETERS["f"].least == -inf

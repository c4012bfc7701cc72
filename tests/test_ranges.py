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
from dimersweep.symbols import EVENTS, PARAMETERS, QUANTITIES, STATES

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
    for name, quantity in EVENTS.items():
        if run.events[name].dtype.kind == "f":
            in_range(name, run.events[name], quantity)
    states = run.states(np.linspace(0, run.n_periods / scene["f"], 50))
    for name, quantity in STATES.items():
        in_range(name, states[name], quantity)


@pytest.mark.parametrize("record", [True, False])
def test_a_rest_that_is_told_early_has_shares_of_what_was_run(record):
    """Both ends bounce until the 14th period: a flight that began before the last 12 counts from their start on."""
    given = {"Gamma": 0.9, "f": 25, "beta0": np.radians(88), "periods": 200}
    run = dimersweep.simulate(**given, stop_when_settled=True, record=record)
    assert run.mode == "rest"
    assert 0 < run.down_share_2 < run.down_share_1 < 1
    end, f = run.n_periods, 25
    if record:
        ends = run.events.to_dataframe()
        for end_of_rod, told in ((1, run.down_share_1), (2, run.down_share_2)):
            assert told == pytest.approx(share_by_events(ends, end_of_rod, (end - 12) / f, end / f), abs=1e-9)


def share_by_events(events, end, start, stop):
    """Share of a stretch that an end is in no flight of half a period or more, from its hits and its times of contact."""
    T, away = 1 / 25, 0.0
    how = {"contact_after": "last", f"impulse_{end}": "max"}  # an impact has several rows
    events = events.groupby("time", as_index=False).agg(how)
    closed = events["contact_after"].str.startswith(("D", f"SC{end}"))
    hit = events[f"impulse_{end}"] > 0
    leaves = events["time"][(hit | closed.shift(fill_value=True)) & ~closed].unique()  # an end may start in the air
    for taken_off in leaves:
        landings = events["time"][hit & (events["time"] > taken_off)]
        landed = landings.min() if landings.size else stop
        if landed - taken_off >= T / 2:
            away += max(0.0, min(landed, stop) - max(taken_off, start))
    return 1 - away / (stop - start)


def test_a_flight_that_goes_on_at_the_end_counts_as_long():
    # thrown up by hard shaking, both ends fly over many periods: the last 12 are mostly flight
    run = dimersweep.simulate(Gamma=8.0, f=40, e=0.9, periods=60)
    assert 0 <= run.down_share_1 < 0.2
    assert 0 <= run.down_share_2 < 0.2


def test_ranges_are_stated_where_there_is_one():
    for name in ("zeta", "impact_phase", "down_share_1", "down_share_2"):
        assert -inf < QUANTITIES[name].least < QUANTITIES[name].most < inf
    assert (STATES["beta"].least, STATES["beta"].most) == (-pi / 2, pi / 2)
    assert {*OUT, *CODES} <= set(QUANTITIES)


def test_a_cube_tells_the_ranges():
    cube = build(make_grid({"f": [15, 20]}), np.full((2, N_OUT), np.nan), np.zeros((2, N_CODES), dtype=np.int64), {})
    assert cube["down_share_1"].attrs["valid_max"] == 1
    assert cube["n_events"].attrs["valid_min"].dtype == cube["n_events"].dtype
    assert "valid_min" not in cube["precession_rate"].attrs
    assert names(cube["mode"]).values.tolist() == ["not_run", "not_run"]
    assert "valid_min" not in cube["f"].attrs and PARAMETERS["f"].least == -inf

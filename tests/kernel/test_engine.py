"""The event loop: what is conserved, what stays put, what comes to rest, that it is deterministic and always ends."""

import threading
from math import pi

import numpy as np
import pytest

from dimersweep import names, simulate
from dimersweep.kernel import batch
from dimersweep.kernel.compiler.records import record_type
from dimersweep.kernel.course import BUDGET, BUDGET_PER_PERIOD, new_workspace
from dimersweep.kernel.model import layout
from dimersweep.kernel.model.body import dimer_of
from dimersweep.kernel.model.contact_code import CONTACT_STATES, code_of, digits_of
from dimersweep.kernel.model.event_row import E_A1, E_CAUSE, E_N1, E_P1, EVENT
from dimersweep.kernel.model.layout import CODES, MODES, N_CODES, N_OUT, OUT, ROW, STATUS_MESSAGES, STATUSES
from dimersweep.parameters import Parameters, fill_rows
from tests.checks.data import data
from tests.checks.random_scenes import near
from tests.checks.verbs import row_of

CODE = {name: k for k, name in enumerate(CODES)}
M, J_T, J_A, G, H = 8.813633469891e-3, 5.299695485087e-6, 8.339127315493e-8, 9.81, 0.025  # the base case


def outcome(row, periods, rtol=1e-8, settle=False):
    """Numbers and codes of one run without a record."""
    rows = np.atleast_2d(row)
    out, codes = np.full((len(rows), N_OUT), np.nan), np.zeros((len(rows), N_CODES), dtype=np.int64)
    batch.run_many(rows, periods, rtol, settle, out, codes)
    return out, codes


def status_and_mode(row, periods, rtol=1e-8):
    _, codes = outcome(row, periods, rtol)
    return STATUSES[codes[0, CODE["status"]]], MODES[codes[0, CODE["mode"]]]


def energy(states):
    """Energy of the base case's dimer in the frame of the plate, where gravity is taken as constant."""
    speed2 = _centre_speeds(states)
    axial = states["gamma_rate"] + states["theta_rate"] * np.sin(states["beta"])
    turning = states["beta_rate"] ** 2 + (states["theta_rate"] * np.cos(states["beta"])) ** 2
    height = 0.5 * (states["gap_1"] + states["gap_2"])
    return (0.5 * (M * speed2 + J_T * turning + J_A * axial**2) + M * G * height).values


def _centre_speeds(states):
    """Square of the centre's speed relative to the plate."""
    s_b, c_b = np.sin(states["beta"]), np.cos(states["beta"])
    s_t, c_t = np.sin(states["theta"]), np.cos(states["theta"])
    w_b, w_t = states["beta_rate"], states["theta_rate"]
    x = states["x1_rate"] - H * (c_b * c_t * w_t - s_b * s_t * w_b)
    y = states["y1_rate"] - H * (c_b * s_t * w_t + s_b * c_t * w_b)
    n = 0.5 * (states["gap_1_rate"] + states["gap_2_rate"])
    return x**2 + y**2 + n**2


@pytest.mark.long_uncompiled
@pytest.mark.parametrize("params", [{"beta0": 0.0, "Gamma": 0.5}, {"beta0": 0.0, "Gamma": 0.5, "xdot0": 0.0}])
def test_a_dimer_that_lies_on_the_plate_stays_there(params):
    run = simulate(**params, e=0.0, periods=6)
    late = run.states(np.linspace(3, 6, 31) / 15.0)
    assert (run.status, run.mode) == ("ok", "rest")
    assert not (late["gap_1"].values.any() or late["gap_2"].values.any() or late["beta"].values.any())
    assert not late["gap_2_rate"].values.any()


@pytest.mark.long_uncompiled
@pytest.mark.parametrize("params", [{}, {"xdot0": 0.0}, {"mu": 0.0, "mu_s": 0.0}, {"e": 0.9}])
def test_on_a_dead_plate_everything_comes_to_rest(params):
    run = simulate(**params, Gamma=0.0, periods=40)
    assert (run.status, run.mode) == ("ok", "slides" if params.get("mu") == 0.0 else "rest")
    states = run.states(np.linspace(0, 40 / 15, 401))
    levels = energy(states)
    assert (np.diff(levels) <= 1e-9 * levels[0]).all()  # an error of the default accuracy may add a little
    assert levels[-1] < levels[0]
    end = states.isel(time=-1)
    assert end["gap_1"] == end["gap_2"] == end["beta_rate"] == 0


@pytest.mark.jit
@pytest.mark.parametrize("plate", [{"Gamma": 0.4}, {"Gamma": 0.4, "Gamma_2": 0.6, "phi_2": 1.0}])
def test_elastic_bounces_on_a_moving_plate_gain_what_the_plate_gives(plate):
    """Work of the plate on the dimer: the sum of the impulses times the plate's speed. Over 1,000 periods."""
    periods = 1000
    run = simulate(e=1, mu=0, mu_s=0, **plate, periods=periods, rtol=1e-11)
    assert run.status == "ok"
    events = run.events.isel(event=run.events["time"].values > 0)  # the first state is that after the first impact
    work = _plate_speed(events, **plate) * (events["impulse_1"] + events["impulse_2"]).values
    ends = run.states([0, periods / 15])
    in_the_lab = {f"gap_{i}_rate": ends[f"gap_{i}_rate"] + _plate_speed(ends, **plate) for i in (1, 2)}
    in_the_lab |= {f"gap_{i}": ends[f"gap_{i}"] + ends["plate"] for i in (1, 2)}
    first, last = energy(ends.assign(in_the_lab))
    exchanged = np.abs(work).sum()
    assert exchanged > 10 * first
    assert last - first == pytest.approx(work.sum(), abs=1e-9 * exchanged)


def _plate_speed(dataset, Gamma, Gamma_2=0.0, phi_2=0.0):
    omega, t = 2 * pi * 15, dataset["time"].values
    return Gamma * G / omega * np.cos(omega * t) + Gamma_2 * G / (2 * omega) * np.cos(2 * omega * t + phi_2)


@pytest.mark.parametrize("periods", [3])
def test_runs_are_deterministic_to_the_last_bit(periods):
    row = row_of()
    first, again = outcome(row, periods), outcome(row, periods)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])


def varied_rows(n):
    rng = np.random.default_rng(8)
    return np.array(
        [row_of(beta0=rng.uniform(0.02, 1.4), Gamma=rng.uniform(0.3, 1.5), A_r=rng.uniform(3, 8)) for _ in range(n)]
    )


@pytest.mark.jit
def test_many_runs_are_the_runs_one_at_a_time_bit_for_bit():
    rows = varied_rows(12)
    out, codes = outcome(rows, 60, settle=True)
    for k, row in enumerate(rows):
        single_out, single_codes = outcome(row, 60, settle=True)
        np.testing.assert_array_equal(single_out[0], out[k])
        np.testing.assert_array_equal(single_codes[0], codes[k])
    assert len({tuple(line) for line in codes}) > 6


@pytest.mark.jit
def test_a_run_that_dies_is_the_same_whether_or_not_its_last_period_is_followed_to_the_end():
    died = 0
    for row in varied_rows(20):
        scene = dict(zip(ROW[2:], row[2:], strict=True)) | {"e_1": row[0], "e_2": row[1]}
        cut, whole = (simulate(**scene, periods=60, stop_when_settled=True, record=record) for record in (False, True))
        died += cut.mode == "rest"
        for name in ("status", "mode", "n_events", "n_periods", "down_share_1", "down_share_2"):
            assert getattr(cut, name) == pytest.approx(getattr(whole, name), nan_ok=True), name
        assert whole.events["time"].values[-1] * scene["f"] == pytest.approx(whole.n_periods)
    assert died > 3


@pytest.mark.jit
def test_a_jump_whose_hops_last_half_a_period_is_a_jump():
    """One end flies for just more than half a period and the other one for just less, until both do the latter."""
    scene = data("scenes")["motions"]["hops for half a period"]
    runs = [simulate(**scene, periods=periods, record=False) for periods in (32, 40, 60)]
    assert [run.mode for run in runs] == ["jump"] * 3
    assert runs[0].down_share_2 < 0.6
    assert runs[2].down_share_2 == 1.0


@pytest.mark.jit
def test_the_order_of_the_runs_is_of_no_consequence():
    rows = varied_rows(8)
    out, codes = outcome(rows, 40)
    back, back_codes = outcome(rows[::-1].copy(), 40)
    np.testing.assert_array_equal(back[::-1], out)
    np.testing.assert_array_equal(back_codes[::-1], codes)


@pytest.mark.jit
def test_the_kernel_is_compiled_once():
    outcome(row_of(), 2)
    outcome(varied_rows(3), 3, 1e-6, True)
    simulate(periods=2, record=True)
    simulate(periods=2, record=False, stop_when_settled=True, e=1, mu=0, mu_s=0, beta0=0)
    assert len(batch.run_rows.dispatcher.signatures) == 1


@pytest.mark.jit
def test_rows_may_have_room_beyond_an_outcome():
    out, codes = np.full((2, N_OUT + 7), -1.0), np.full((2, N_CODES + 3), -1)
    batch.run_many(varied_rows(2), 5, 1e-6, False, out, codes)
    expected, expected_codes = outcome(varied_rows(2), 5, 1e-6)
    np.testing.assert_array_equal(out[:, :N_OUT], expected)
    np.testing.assert_array_equal(codes[:, :N_CODES], expected_codes)
    assert (out[:, N_OUT:] == -1).all() and (codes[:, N_CODES:] == -1).all()


def test_slots_are_those_of_the_names():
    assert [getattr(layout, f"CODE_{name.upper()}") for name in CODES] == list(range(layout.N_CODES))
    numbers = np.arange(float(layout.N_OUT))
    out = numbers.view(record_type(layout.Outcome))[0]
    for name in OUT:
        value = name.removesuffix("_drift")
        if value in OUT[: layout.N_ORBIT]:
            found = (out.orbit if name == value else out.drift)[OUT.index(value)]
        else:
            found = getattr(out.run if name in layout.RUN_COLUMNS else out, name)
        assert found == numbers[OUT.index(name)], name
    assert [EVENT[k] for k in (E_CAUSE, E_N1, E_P1, E_A1)] == [
        "cause",
        "gap_1_rate_before",
        "impulse_1",
        "slip_1_a",
    ]


@pytest.mark.jit
def test_the_drift_of_the_base_case_does_not_depend_on_the_accuracy():
    answers, radii = set(), []
    for exponent in range(6, 13):
        out, codes = outcome(row_of(), 100, 10.0**-exponent)
        answers.add(tuple(codes[0, [CODE[name] for name in ("status", "mode", "mode_period", "di_end")]]))
        radii.append(out[0, OUT.index("radius")])
    assert answers == {(layout.OK, layout.M_DRIFT, 1, layout.DI_SP_SK)}
    np.testing.assert_allclose(radii, 4.2447, rtol=2e-4)


CORNERS = data("scenes")["corners"]["scenes"]


@pytest.mark.parametrize(
    "params", [*CORNERS[:2], *(pytest.param(scene, marks=pytest.mark.long_uncompiled) for scene in CORNERS[2:])]
)
def test_corners_of_the_parameters_run_to_their_end(params):
    run = simulate(**params, periods=4)
    assert (run.status, run.n_periods) == ("ok", 4)
    states = run.states(np.linspace(0, 4 / 15, 201))
    assert states["gap_1"].min() >= 0
    assert states["gap_2"].min() > -1e-14


@pytest.mark.jit
@pytest.mark.parametrize(
    "params", [{"mu": 2.0, "mu_s": 2.0}, {"mu": 1.0, "mu_s": 3.0}, {"mu": 5.0, "mu_s": 5.0, "A_r": 2}]
)
def test_large_friction_gives_an_answer_and_not_a_hang(params):
    _, codes = outcome(row_of(**params), 50)
    status = STATUSES[codes[0, CODE["status"]]]
    assert status in ("ok", "jammed", "max_events")
    assert codes[0, CODE["n_events"]] <= BUDGET + BUDGET_PER_PERIOD * 50 + 1


@pytest.mark.jit
@pytest.mark.parametrize("kind", ["any", "equal coefficients", "no restitution", "smooth", "planar", "elastic"])
def test_random_scenes_run_to_their_end(kind):
    columns, zero = near(np.random.default_rng(13), 60), np.zeros(60)
    change = {
        "any": {},
        "equal coefficients": {"mu_s": columns["mu"]},
        "no restitution": {"e": zero},
        "smooth": {"mu": zero, "mu_s": zero},
        "planar": {"xdot0": zero},
        "elastic": {"e": zero + 1.0, "mu": zero, "mu_s": zero},
    }[kind]
    _, codes = outcome(fill_rows(columns | change, 60), 20)
    failed = [(k, STATUSES[code]) for k, code in enumerate(codes[:, CODE["status"]]) if code != layout.OK]
    assert not failed


@pytest.mark.jit
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("case", data("hesitant")["scenes"], ids=lambda case: case["broke"])
def test_scenes_make_headway(case, rtol):
    _, codes = outcome(row_of(**case["scene"]), 33, rtol)
    assert STATUSES[codes[0, CODE["status"]]] == "ok"
    assert codes[0, CODE["n_periods"]] == 33


@pytest.mark.long_uncompiled
def test_a_ball_chatters_to_rest_and_is_thrown_off_again():
    run = simulate(Gamma=1.3, beta0=0.2, periods=8)
    events = names(run.events)
    causes = list(events["cause"].values)
    assert "chatter_end" in causes
    later = causes[causes.index("chatter_end") :]
    assert "lift_off" in later
    # where the plate falls faster than gravity both ends leave it, and with it every contact
    thrown = (events["cause"].values == "lift_off") & (events["contact_after"].values == "FM")
    assert thrown.any()
    acceleration = 1.3 * np.sin(events["phase"].values[thrown])
    assert (acceleration > 0.5).all()


@pytest.mark.jit
def test_a_bound_on_the_events_ends_a_run():
    """A ball bounces elastically more often in a period of a day than the bound allows."""
    status, mode = status_and_mode(row_of(e=1, mu=0, Gamma=0, f=1e-5, beta0=1e-3), 1)
    assert (status, mode) == ("max_events", "failed")


def test_every_answer_has_a_name_and_every_status_a_message():
    assert len(STATUSES) == len(STATUS_MESSAGES) == len(set(STATUSES)) == len(set(STATUS_MESSAGES))
    codes = {name: getattr(layout, name.upper()) for name in STATUSES}
    assert list(codes.values()) == list(range(len(STATUSES)))
    for prefix, words in (("M_", layout.MODES), ("DI_", layout.DI_ENDS), ("C_", layout.CAUSES)):
        assert [getattr(layout, prefix + name.upper()) for name in words] == list(range(len(words)))


def test_contact_states_are_those_of_table_1():
    table = """
        FM      SC2_sk    SC2_sp    SI2_sk    SI2_sp
        SC1_sk  DC_sk_sk  DC_sk_sp  DI_sk_sk  DI_sk_sp
        SC1_sp  DC_sp_sk  DC_sp_sp  DI_sp_sk  DI_sp_sp
        SI1_sk  DI_sk_sk  DI_sk_sp  DI_sk_sk  DI_sk_sp
        SI1_sp  DI_sp_sk  DI_sp_sp  DI_sp_sk  DI_sp_sp
    """
    assert list(CONTACT_STATES) == table.split()
    codes = np.arange(25)
    np.testing.assert_array_equal(np.array(table.split()).reshape(5, 5)[digits_of(codes)], CONTACT_STATES)
    np.testing.assert_array_equal(code_of(*digits_of(codes)), codes)


def test_a_run_starts_as_the_paper_says():
    """p1 on the plate and at rest in space but for xdot0, so that the plate hits it at once."""
    run = simulate(phi0=0.7, beta0=0.4, xdot0=0.8, periods=1)
    first = names(run.events).isel(event=0)
    assert (first["time"].item(), first["cause"].item(), first["kind"].item()) == (0, "impact", "SI1_sp")
    rise = 0.9 * G / (2 * pi * 15) * np.cos(0.7)
    for rate in ("gap_1_rate_before", "gap_2_rate_before"):
        assert first[rate].item() == pytest.approx(-rise, rel=1e-14)
    assert first["beta"].item() == 0.4


@pytest.mark.long_uncompiled
def test_a_batch_ends_with_the_first_run_of_a_wanted_mode():
    rows = np.array([row_of(beta0=b) for b in (0.5, 1.2, 0.279)])
    out, codes = np.full((3, N_OUT), np.nan), np.zeros((3, N_CODES), dtype=np.int64)
    made = batch.run_many(rows, 300, 1e-8, True, out, codes, 1 << MODES.index("drift"))
    assert made == 2
    assert [MODES[mode] for mode in codes[:, CODE["mode"]]] == ["rest", "drift", "not_run"]


@pytest.mark.jit
@pytest.mark.parametrize("changes", [{}, {"Gamma": 2.5, "e": 0.9}, {"Gamma": 0.3}], ids=["drift", "flights", "rest"])
def test_a_run_can_be_stopped_from_another_thread(changes):
    rows = np.array([row_of(beta0=0.5), row_of(**changes)])
    whole = outcome(rows[:1], 1, settle=True)
    for seconds in (0.01, 0.1, 1.0, 10.0):  # until it has come somewhere
        out, codes, space = np.full((2, N_OUT), np.nan), np.zeros((2, N_CODES), dtype=np.int64), new_workspace()
        assert batch.run_many(rows[:1], 1, 1e-8, True, out[:1], codes[:1], 0, space) == 1
        assert (codes[0].tolist(), out[0].tobytes()) == (whole[1][0].tolist(), whole[0][0].tobytes())
        later = threading.Timer(seconds, batch.stop, (space,))
        later.start()
        made = batch.run_many(rows, 10**9, 1e-8, False, out, codes, 0, space)  # it would take weeks
        assert made == 0 and batch.is_stopped(space)
        assert (STATUSES[codes[0, CODE["status"]]], MODES[codes[0, CODE["mode"]]]) == ("stopped", "failed")
        assert codes[1].tolist() == [0] * N_CODES
        if codes[0, CODE["n_periods"]]:
            break
    assert codes[0, CODE["n_periods"]] > 0


# --- a dimer that lands flat, and one that was always slow ---------------------------------------------------------------


@pytest.mark.jit
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11, 1e-12])
def test_flat_landing(rtol):
    """It leaves flat, with the restitution of a single ball."""
    e = 0.54
    events = simulate(e=e, Gamma=1.28, f=16.07, A_r=4.78, beta0=0.13, periods=4, rtol=rtol).events
    first = np.flatnonzero(events["time"].values * 16.07 > 3.5)[0]  # it has rested flat, and the plate has thrown it
    last = np.flatnonzero(events["time"].values == events["time"].values[first])[-1]
    for end in ("gap_1_rate", "gap_2_rate"):
        out, into = events[f"{end}_after"].values[last], events[f"{end}_before"].values[first]
        assert out == pytest.approx(-e * into, rel=1e-6)


@pytest.mark.jit
@pytest.mark.parametrize("xdot0", [0.0, 0.3])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-11])
def test_a_flat_dimer_stays_flat(xdot0, rtol):
    """Its ends move alike to the last digit, through bounces, chatter and the slip of both."""
    run = simulate(e=0.6, Gamma=1.2, phi0=1.0, beta0=0.0, xdot0=xdot0, periods=10, rtol=rtol)
    assert run.status == "ok"
    assert not run.events["beta"].values.any()
    rates = [run.events[f"gap_{end}_rate_after"].values for end in (1, 2)]
    np.testing.assert_allclose(*rates, rtol=1e-15)


ENDS = {"e_1": 0.5, "e_2": 0.8, "r_1": 5e-3, "r_2": 5.2e-3, "mu": 0.2, "mu_s": 0.2, "Gamma": 0.0}
LEVEL = float(dimer_of(Parameters(**ENDS).row()).beta_0)
AFTER = ("gap_1_rate_after", "gap_2_rate_after", "slip_1_a", "slip_1_b", "slip_2_b")


def first_impact(gap0, beta0, rtol):
    """Velocities after the first impact of a drop from `gap0`, with a slip that goes with it, over that of the landing."""
    v = np.sqrt(2 * 9.81 * gap0)
    events = simulate(**ENDS, gap0=gap0, beta0=beta0, xdot0=1.3 * v, ydot0=-0.4 * v, periods=1, rtol=rtol).events
    impacts = np.flatnonzero(names(events["cause"]) == "impact")
    times = events["time"].values[impacts]
    last = impacts[times == times[0]][-1]
    return np.array([events[name].values[last] for name in AFTER]) / v


@pytest.mark.jit
@pytest.mark.parametrize("beta0", [LEVEL, 0.4], ids=["both ends", "one end"])
@pytest.mark.parametrize("gap0", [1e-6, 1e-10, 1e-14])
def test_an_impact_of_a_motion_that_was_always_slow_is_as_exact_as_any(gap0, beta0):
    """The law of impact knows no speed: all velocities after it grow in proportion to those before."""
    exact = first_impact(1e-6, beta0, 1e-12)
    np.testing.assert_allclose(first_impact(gap0, beta0, 1e-9), exact, rtol=0, atol=2e-10)

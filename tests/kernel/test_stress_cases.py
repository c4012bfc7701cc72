"""Scenes that the stress suite has found and made simple: each once hung, sank, gained energy or had no answer."""

from math import inf

import pytest

from dimersweep import simulate
from dimersweep.kernel.model.layout import OK
from dimersweep.parameters import Parameters
from tests.checks.data import data
from tests.checks.examine import CODE, examine, lies
from tests.checks.random_scenes import faults, lying_nan, rows_of, run_block, scene_row

pytestmark = pytest.mark.jit

SCENES = data("stress")  # each with what it broke


@pytest.mark.parametrize("case", SCENES["mended"], ids=lambda case: case["broke"])
def test_a_scene_that_once_failed(case):
    assert faults(case["scene"], case["periods"], 1e-8) == []


@pytest.mark.parametrize("case", [SCENES["mended"][-1], *SCENES["jamming"]], ids=lambda case: case["broke"])
def test_a_slip_that_jams_is_stopped(case):
    look = examine(Parameters(**case["scene"]).row(), 1, 1e-8)
    assert max(look["gain"].values()) < 1e-9
    assert look["flips"] == 0


@pytest.mark.parametrize("domain", ["near", "far", "whole"])
def test_random_scenes(domain):
    """A short run of the suite: every scene ends, in few events, and those looked at show nothing wrong."""
    codes, out, _, work = run_block(rows_of(0, 1000, 7, domain), 5, 1e-8, longest=inf)
    status = codes[:, CODE["status"]]
    assert (status == OK).mean() > 0.98
    assert not lying_nan(codes, out).any()
    assert work.max() < 400_000
    looks = [examine(scene_row(k, 7, domain), 5, 1e-8) for k in range(0, 1000, 40) if status[k] == OK]
    assert [lies(look) for look in looks] == [[]] * len(looks)


@pytest.mark.parametrize("case", SCENES["faint"], ids=lambda case: case["broke"])
def test_an_end_that_hardly_presses_leaves(case):
    run = simulate(**case["scene"], periods=case["periods"], rtol=case["rtol"], record=False, stop_when_settled=False)
    assert run.status == "ok"


@pytest.mark.parametrize("number", [7890, 10227, 15342, 252152, 259397])
def test_hops_without_end(number):
    """Both ends hop at 1 - e below 1e-7, and so faintly that a period has millions of hops: it once ended in `max_events`."""
    codes, _, _, work = run_block(scene_row(number, 11, "far")[None], 5, 1e-8, longest=inf)
    assert codes[0, CODE["status"]] == OK
    assert codes[0, CODE["n_events"]] < 1_000_000
    assert work[0] < 1_200_000


@pytest.mark.parametrize("number", [3918, 5406, 5969, 66316])
def test_hops_of_round_off(number):
    """Beside an end that hops by no more than round-off the other one leaves: its close is not followed to denormal rates."""
    look = examine(scene_row(number, 11, "far"), 5, 1e-8)
    assert look["status"] == "ok"
    assert look["n_events"] < 1000
    assert lies(look) == []


@pytest.mark.parametrize("number", [188650, 752250])
def test_no_energy_from_nothing(number):
    """A swift turn that pulls at the plate from its start; a scene so slow that each of its impacts counts."""
    look = examine(scene_row(number, 11, "far"), 1, 1e-8)
    assert (look["status"], lies(look)) == ("ok", [])


ONE_MOMENT = [(case["broke"], number) for case in SCENES["one_moment"] for number in case["numbers"]]


@pytest.mark.parametrize(("broke", "number"), ONE_MOMENT)
def test_a_contact_does_not_go_round_at_one_moment(broke, number):
    row = scene_row(number, 11, "whole")
    codes, _, _, work = run_block(row[None], 5, 1e-8)
    assert codes[0, CODE["status"]] == OK, broke
    assert work[0] < 30_000
    assert lies(examine(row, 5, 1e-8)) == [], broke

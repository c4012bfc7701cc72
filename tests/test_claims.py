"""The ledger tries what it says it tries: its verdicts follow from the runs, and turn when the runs do."""

import re

import pytest

from dimersweep.claims import CLAIMS, Finding, Lab, Row, as_markdown, sect3, sect4
from dimersweep.claims.ledger import verdict
from dimersweep.runs.simulating import simulate


@pytest.fixture(scope="module")
def lab():
    return Lab(small=True, progress=False)


@pytest.fixture(scope="module")
def other_lab():
    """A lab whose base case has the small friction, and whose friction is that of the base case."""
    swapped = Lab(small=True, progress=False)
    swapped.__dict__["base"] = simulate(periods=200, mu=0.05, mu_s=0.1)
    swapped.__dict__["low"] = simulate(periods=200)
    return swapped


def test_every_claim_has_a_section_and_is_said_once():
    assert len(CLAIMS) >= 40
    assert all(re.fullmatch(r"[345]\.[123]", claim.section) for claim in CLAIMS)
    assert len({claim.statement for claim in CLAIMS}) == len(CLAIMS)


@pytest.mark.jit
@pytest.mark.parametrize(
    "check",
    [
        sect3.base_drifts,
        sect3.course_of_impact,
        sect3.first_quadrant,
        sect3.opposite_velocities,
        sect3.angles_repeat,
        sect3.d_shape,
        sect3.theta_in_impacts,
        sect3.circular,
        sect4.inward_spiral,
        sect4.spiral_slows,
    ],
)
def test_what_the_paper_says_of_its_two_runs_agrees(lab, check):
    assert check(lab).verdict == "agrees", check(lab)


@pytest.mark.jit
def test_contact_rolls_where_the_paper_says_it_slips(lab):
    assert sect3.sliding_contact(lab).verdict == "differs"
    assert sect3.shares(lab.base)["SC1_sk"] == pytest.approx(0.76, abs=0.01)


@pytest.mark.jit
@pytest.mark.parametrize("check", [sect3.course_of_impact, sect4.inward_spiral])
def test_verdicts_turn_with_the_runs(other_lab, check):
    assert check(other_lab).verdict == "differs"


def test_verdicts():
    assert [verdict(True), verdict(False, True), verdict(False)] == ["agrees", "partly", "differs"]


def test_the_page_counts_and_lists_every_row():
    rows = [
        Row("3.1", "It drifts", Finding("it does", "agrees", "mode")),
        Row("5.2", "R", Finding("r", "differs", "x")),
    ]
    page = as_markdown(rows, ["## Study"], Lab(small=True), 0.0)
    assert "2 statements: 1 agrees, 0 partly, 1 differs." in page
    assert "| 3.1 | It drifts | it does | **agrees** | mode |" in page
    assert page.endswith("## Study\n")

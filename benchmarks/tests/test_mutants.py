"""The list of mutants: each can be made of today's package, and a mutant that a test sees is told from one that none does."""

import mutants
import pytest
from mutants import Killed, Mutant

LISTED = mutants.mutants()
ROOMS = [
    "kernel",
    "runs",
    "studies",
    "cubes",
    "storage",
    "work",
    "inputs",
    "fits",
    "orbits",
    "plots",
    "exploring",
    "cli",
]


def test_there_are_sixty_over_all_rooms():
    assert len(LISTED) == 60
    assert {each.room for each in LISTED} == set(ROOMS)
    assert sum(each.file.startswith("kernel/") for each in LISTED) <= 12


@pytest.mark.parametrize("mutant", LISTED, ids=lambda mutant: f"{mutant.number}-{mutant.file}")
def test_a_mutant_can_be_made(mutant):
    assert mutants.why_not(mutant) == ""


@pytest.mark.parametrize(
    ("was", "becomes", "why"),
    [
        ("no such line", "another", "has 0 times 'no such line'; must be once"),
        ("import", "export", "must be once"),
        (
            "PROOF_PERIODS, PROOF_RTOL =",
            "PROOF_PERIODS, PROOF_RTOL =",
            "must become another part of one line",
        ),
    ],
)
def test_what_is_no_mutant_is_told(was, becomes, why):
    assert why in mutants.why_not(Mutant(1, "work", "work/proving.py", was, becomes, ""))


def test_the_tests_that_are_tried_first_are_there_and_no_other_file_is_named():
    assert {*mutants.NEAREST} == {each.file for each in LISTED}
    for mutant in LISTED:
        near, others = mutants.files_of(mutant)
        assert all((mutants.ROOT / name).is_file() for name in near)
        assert not {*near} & {*others} and not {*mutants.OF_TEXT} & {*near, *others}


@pytest.mark.parametrize(("only", "numbers"), [("3,7-9", [3, 7, 8, 9]), ("", [*range(1, 61)])])
def test_some_are_chosen(only, numbers):
    assert [each.number for each in mutants.chosen(only, LISTED)] == numbers


def test_a_room_is_chosen():
    assert {each.room for each in mutants.chosen("fits", LISTED)} == {"fits"}


def test_the_table_counts_those_that_tests_see_and_half_those_of_the_proof():
    seen, proven, unseen = (
        Killed("tests/test_run.py::test_a[x|y]", 12.3, True),
        Killed("", 50.0, True),
        Killed("", 50.0, False),
    )
    told = mutants.table(LISTED[:4], dict(zip(map(mutants.key_of, LISTED), (seen, proven, unseen), strict=False)))
    assert told.splitlines()[2].endswith("| `tests/test_run.py::test_a[x&#124;y]`, and the proof of bits | 12 |")
    assert told.splitlines()[4].endswith("| **nothing** | 50 |")
    assert told.splitlines()[5].endswith("| not tried |  |")
    assert told.endswith("\n1.5 of 4")


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout of one module, one test of it, and one that fails in any case; with the program set to it."""
    (tmp_path / "dimersweep" / "work").mkdir(parents=True)
    (tmp_path / "dimersweep" / "work" / "half.py").write_text("def half(x):\n    return x / 2\n")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_work.py").write_text(
        "import pytest\nfrom runpy import run_path\n\n\ndef test_broken():\n    assert False\n\n\n"
        "def test_half():\n    assert run_path('dimersweep/work/half.py')['half'](2) == 1\n"
    )
    (tmp_path / "pyproject.toml").write_text('[tool.pytest.ini_options]\nmarkers = ["release", "slow", "jit"]\n')
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # of which these tests need none
    monkeypatch.setitem(mutants.NEAREST, "work/half.py", "test_work")
    return tmp_path


def test_a_mutant_is_seen_by_a_test_that_passes_without_it(checkout):
    mutant = Mutant(1, "work", "work/half.py", "x / 2", "x * 2", "")
    told = mutants.killed(mutant, checkout, 100.0)
    assert told.by == "tests/test_work.py::test_half"
    assert (checkout / "dimersweep" / mutant.file).read_text().endswith("x / 2\n")


def test_a_mutant_that_no_test_sees_is_told(checkout):
    assert mutants.killed(Mutant(1, "work", "work/half.py", "x / 2", "x * 0.5", ""), checkout, 100.0).by == ""

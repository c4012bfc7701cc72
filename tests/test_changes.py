"""Eight changes that people make: each is a patch in `changes`, takes the files that CONTRIBUTING.md names, and works."""

import re
import shutil
from pathlib import Path

import pytest

from tests.checks.patched import UNCOMPILED, apply, copy_to, run_copy, touched

ROOT = Path(__file__).parents[1]
needs_git = pytest.mark.skipif(not shutil.which("git"), reason="patches are applied by git")
CHANGES = sorted((Path(__file__).parent / "changes").glob("*.patch"))


def table():
    """The rows of CONTRIBUTING's table of changes: what is wanted, as the name of a patch, and what is to be opened."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (an?other [^|]*|a new [^|]*|restitution [^|]*|something [^|]*) \| (.*) \|$", text, re.MULTILINE
    )
    return {re.sub(r"\W+", "_", wanted): where for wanted, where in rows}


def test_there_are_eight_changes():
    assert len(CHANGES) == 8
    assert {change.stem for change in CHANGES} <= set(table())


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.stem)
def test_the_table_names_exactly_the_files_that_a_change_takes(change):
    where = table()[change.stem]
    files = touched(change.read_text(encoding="utf-8"))
    new = {file for file in files if not (ROOT / file).exists()}
    assert files - new == set(re.findall(r"`(dimersweep/[\w/]+\.py)`", where))
    assert {str(Path(file).parent) for file in new} == set(re.findall(r"`(dimersweep/[\w/]+)/`", where))


# a change of the kernel and one of files are tried before a change of ours, all of them before a release
USUAL = {"another_law_of_friction", "another_format_of_cubes"}


@pytest.fixture
def changed(change, tmp_path):
    """The folder of a copy of the package with a change."""
    copy_to(tmp_path)
    apply(change, tmp_path)
    return tmp_path


@needs_git
@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.stem)
def test_a_change_is_to_the_package_as_it_is(change, changed):
    assert all((changed / file).is_file() for file in touched(change.read_text(encoding="utf-8")))


@pytest.mark.slow
@needs_git
@pytest.mark.parametrize(
    "change",
    [pytest.param(each, marks=[] if each.stem in USUAL else pytest.mark.release, id=each.stem) for each in CHANGES],
)
def test_a_change_works(change, changed):
    """Its trial, beside it, runs with the copy: uncompiled where the kernel is another one."""
    physics = any(file.startswith("dimersweep/kernel/") for file in touched(change.read_text(encoding="utf-8")))
    run_copy(changed, change.with_suffix(".py"), UNCOMPILED if physics else {})

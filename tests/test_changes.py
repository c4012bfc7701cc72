"""Eight changes that people make: each is a patch in `changes`, takes the files that CONTRIBUTING.md names, and works."""

import re
import shutil
from pathlib import Path

import pytest

from tests.checks.patched import UNCOMPILED, apply, copy_to, run_copy, touched

ROOT = Path(__file__).parents[1]
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


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("git"), reason="patches are applied by git")
@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.stem)
def test_a_change_works(change, tmp_path):
    """Its trial, beside it, runs with the copy: uncompiled where the kernel is another one."""
    copy_to(tmp_path)
    apply(change, tmp_path)
    physics = any(file.startswith("dimersweep/kernel/") for file in touched(change.read_text(encoding="utf-8")))
    run_copy(tmp_path, change.with_suffix(".py"), UNCOMPILED if physics else {})

"""Whether files are what the conventions say, by the checker of others."""

from functools import cache

import pytest


def conforms(path):
    """A file is CF, as its checker says; its report is in the message where it is not."""
    checker = pytest.importorskip("compliance_checker.runner")
    util = pytest.importorskip("compliance_checker.cf.util")
    checker.CheckSuite.load_all_available_checkers()
    report = path.with_suffix(".txt")
    with pytest.MonkeyPatch.context() as patch:
        for kind in ("auxiliary_coordinate", "axis", "time"):  # asked for hundreds of times, with the same answer
            patch.setattr(util, name := f"get_{kind}_variables", cache(getattr(util, name)))
        passed, failed = checker.ComplianceChecker.run_checker(
            str(path), ["cf:1.11"], 0, "strict", output_filename=str(report), output_format="text"
        )
    assert passed and not failed, report.read_text()

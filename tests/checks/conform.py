"""Whether files are what the conventions say, by the checker of others."""

import re
from functools import cache

import pytest


def conforms(path):
    """A file is CF, as its checker says; its report is in the message where it is not."""
    checker = pytest.importorskip("compliance_checker.runner")
    util = pytest.importorskip("compliance_checker.cf.util")
    checker.CheckSuite.load_all_available_checkers()
    report = path.with_suffix(".txt")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("is_geophysical", *(name for name in vars(util) if re.fullmatch(r"get_\w+_variables?", name))):
            patch.setattr(util, name, cache(getattr(util, name)))  # asked for hundreds of times, with the same answer
        passed, failed = checker.ComplianceChecker.run_checker(
            str(path), ["cf:1.11"], 0, "strict", output_filename=str(report), output_format="text"
        )
    assert passed and not failed, report.read_text()

"""What is said of tests that were left out."""

from tests.conftest import left_out


def test_each_kind_of_test_that_is_left_out_is_named_with_its_reason():
    assert left_out([]) == "tests left out: none"
    reasons = ["pages are not tried in a browser: no Chromium", "an hour: set DIMERSWEEP_SLOW=1"]
    reasons += ["no reference runs", reasons[0], "of its own"]
    assert left_out(reasons) == (
        "tests left out: 2 browser (pages are not tried in a browser: no Chromium); 1 other (of its own); "
        "1 references (no reference runs); 1 slow (an hour: set DIMERSWEEP_SLOW=1)"
    )

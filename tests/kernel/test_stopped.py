"""What a run that is stopped has written: tests around the kernel make such records by `tests.seams.cut_back`."""

import numba
import numpy as np
import pytest

from dimersweep.cubes.cube import blank
from dimersweep.kernel import event_loop
from dimersweep.kernel.batch import run_recorded, run_request
from dimersweep.kernel.model.layout import CODE_N_PERIODS, CODE_STATUS, PERIOD, STOPPED
from dimersweep.kernel.record import new_record, rows_of
from dimersweep.parameters import Parameters
from tests.seams import cut_back


@pytest.mark.skipif(not numba.config.DISABLE_JIT, reason="a function of compiled code cannot be replaced")
@pytest.mark.parametrize("scene", [{}, {"Gamma": 0.5, "xdot0": 0.0, "beta0": 0.0}, {"Gamma": 3.0}])
def test_a_stop_cuts_the_record_where_a_smooth_phase_begins(scene, monkeypatch):
    row = Parameters(**scene).row()

    def record_of(looks):
        """The record and the codes of a run that is stopped when the loop looks at its meter for this time."""
        left = iter(range(looks))
        monkeypatch.setattr(event_loop, "is_over", lambda meter: next(left, None) is None)
        monkeypatch.setattr(event_loop, "why_over", lambda meter: STOPPED)
        (out, codes), record = blank(1), new_record(500)
        run_recorded(row, run_request(1, 1e-6), out, codes, record)
        return record, codes[0]

    whole, codes = record_of(1000)
    last, counts = len(rows_of(whole)[1]), whole.counts.copy()
    seen = set()
    for looks in range(8):
        stopped, codes = record_of(looks)
        events, segments = rows_of(stopped)
        assert codes[CODE_STATUS] == STOPPED or len(segments) == last
        if codes[CODE_STATUS] == STOPPED:
            whole.counts[:] = counts
            cut_back(whole, len(segments))
            for mine, cut in zip((events, segments), rows_of(whole), strict=True):
                np.testing.assert_array_equal(mine, cut)
            assert codes[CODE_N_PERIODS] == (segments[-1, PERIOD] if len(segments) else 0)
            seen.add(len(segments))
    assert {0, 1} <= seen

"""A run that is to stop ends, or is left alone, by what stopped it."""

import os
import signal
import threading

import pytest

from dimersweep.work import stopping
from dimersweep.work.stopping import stoppable


@pytest.mark.parametrize("ends", [True, False], ids=["a run that sees the flag", "a compiler that does not"])
def test_ctrl_c_comes_out_as_such(monkeypatch, ends):
    monkeypatch.setattr(stopping, "RUN_GRACE", 60.0 if ends else 0.05)
    seen, late = [], threading.Event()

    def call(flag):
        seen.append(flag)
        os.kill(os.getpid(), signal.SIGINT)
        (flag if ends else late).wait(60)

    with pytest.raises(KeyboardInterrupt):
        stoppable(call)
    assert seen[0].is_set()
    late.set()


def test_a_bound_on_the_time_sets_the_flag_and_waits_for_what_comes_back():
    assert stoppable(lambda flag: flag.wait(60) and "stopped", seconds=0.05) == "stopped"

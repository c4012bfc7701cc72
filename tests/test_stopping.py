"""A run that is to stop ends, or is left alone, by what stopped it."""

import os
import signal
import threading
import time

import pytest

from dimersweep.kernel.batch import is_stopped
from dimersweep.work import stopping
from dimersweep.work.stopping import stoppable


@pytest.mark.parametrize("ends", [True, False], ids=["a run that sees the flag", "a compiler that does not"])
def test_ctrl_c_comes_out_as_such(monkeypatch, ends):
    monkeypatch.setattr(stopping, "RUN_GRACE", 60.0 if ends else 0.05)
    seen, late = [], threading.Event()

    def call(space):
        seen.append(space)
        os.kill(os.getpid(), signal.SIGINT)
        while not (is_stopped(space) if ends else late.wait(60)):
            time.sleep(1e-3)

    with pytest.raises(KeyboardInterrupt):
        stoppable(call)
    assert is_stopped(seen[0])
    late.set()


def test_a_bound_on_the_time_sets_the_flag_and_waits_for_what_comes_back():
    def call(space):
        while not is_stopped(space):
            time.sleep(1e-3)
        return "stopped"

    assert stoppable(call, seconds=0.05) == "stopped"

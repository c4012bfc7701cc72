"""Sweeps on a SLURM of this host: the page's recipe, with a job that is cancelled and Ctrl-C, and an array."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "evidence" / "slurm.py"
LEFT_OUT = 77


@pytest.mark.jit
@pytest.mark.slow
def test_what_happens_on_a_cluster_holds():
    done = subprocess.run([sys.executable, SCRIPT, "--small"], capture_output=True, text=True, timeout=550, check=False)
    if done.returncode == LEFT_OUT:
        pytest.skip(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr

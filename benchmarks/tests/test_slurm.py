"""Sweeps on a SLURM of this host: the page's recipe, with a job that is cancelled and Ctrl-C, and an array."""

import subprocess
import sys
from pathlib import Path

import pytest
from slurm_nodes import why_not

SCRIPT = Path(__file__).parents[1] / "evidence" / "slurm.py"


@pytest.mark.jit
@pytest.mark.slow
@pytest.mark.release  # until the mount of the interpreter, which is read-only now, was tried on a machine that can be lost
def test_what_happens_on_a_cluster_holds():
    pytest.importorskip("dask_jobqueue")
    if why := why_not():
        pytest.skip(why)
    done = subprocess.run([sys.executable, SCRIPT, "--small"], capture_output=True, text=True, timeout=550, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

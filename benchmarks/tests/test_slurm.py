"""A sweep on a SLURM of this host: an array, a job that is cancelled, adaptive clusters, and Ctrl-C."""

import subprocess
import sys
from pathlib import Path

import pytest
from slurm_nodes import why_not

SCRIPT = Path(__file__).parents[1] / "evidence" / "slurm.py"


@pytest.mark.jit
@pytest.mark.release  # some minutes, on a SLURM that must be installed
def test_what_happens_on_a_cluster_holds():
    pytest.importorskip("dask_jobqueue")
    if why := why_not():
        pytest.skip(why)
    done = subprocess.run([sys.executable, SCRIPT, "--small"], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

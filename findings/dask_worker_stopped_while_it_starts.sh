#!/usr/bin/env bash
# A dask worker whose job is cancelled (SIGTERM to all its processes, as by scancel, or by an adaptive cluster that needs the job no
# more) while the nanny starts the worker process has two tracebacks in its log, "Nanny failed to start", and exit status 1, as if
# something were wrong. Where the worker has run for a while, it has none.
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet distributed==2026.8.0
cd "$place"
cat >slow_start.py <<'PY'
import sys
import time

print("worker process begins", file=sys.stderr, flush=True)
time.sleep(2)  # as the modules of a job on a file system of a cluster
PY
cat >told_to_go.py <<'PY'
import os
import signal
import subprocess
import sys
import time

import distributed

OPTIONS = ("--nanny", "--no-dashboard", "--preload", "slow_start.py")

if __name__ == "__main__":
    with distributed.LocalCluster(n_workers=0, dashboard_address=None, host="127.0.0.1") as cluster:
        for moment, seconds in (("worker process begins", 0), ("Registered to", 5)):
            worker = subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address, *OPTIONS],
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            log = ""
            for line in iter(worker.stderr.readline, ""):
                log += line
                if moment in line and "Start Nanny" in log:  # the nanny, too, loads the module, before it starts
                    break
            time.sleep(seconds)
            os.killpg(worker.pid, signal.SIGTERM)
            log += worker.communicate()[1]
            failed = "RuntimeError: Nanny failed to start." in log
            print(distributed.__version__, moment, worker.returncode, log.count("Traceback"), failed, flush=True)
PY
"$place/venv/bin/python" told_to_go.py | tee said.txt
grep -q "worker process begins 1 2 True" said.txt
grep -q "Registered to 0 0 False" said.txt

"""A driver of ``slurm.py``: a sweep on a cluster of SLURM jobs, as docs/cluster.md has it, from a description in JSON.

It writes a line of JSON for each thing that is to be known of it: the workers that there are, the seconds, the cube's checksum.
"""

import json
import sys
import threading
import time
from typing import Any

import dimersweep

BEGUN = time.monotonic()


def tell(**told: Any) -> None:
    """A line of JSON, with the time [s]."""
    print(json.dumps({"at": round(time.monotonic() - BEGUN, 1), "time": time.time()} | told), flush=True)


def busy(dask_worker: Any) -> int:
    """How many tasks a worker is at."""
    return len(dask_worker.active_threads)


def sweep(points: int, **how: Any) -> Any:
    """Points of some 3 ms, the same whoever runs them."""
    grid = {"beta0": {"start": 1, "stop": 80, "num": points, "unit": "deg"}}
    return dimersweep.sweep(grid, **{"periods": 160, "stop_when_settled": False} | how)


def main(asked: dict[str, Any]) -> None:
    """Play a scene."""
    import dask
    from dask_jobqueue import SLURMCluster
    from distributed import Client

    dask.config.set(asked.get("dask", {}))
    how = {"queue": "normal", "cores": 2, "processes": 1, "memory": "1GB", "walltime": "00:30:00", "interface": "lo"}
    how |= {"log_directory": "logs", "local_directory": "space", "scheduler_options": {"dashboard_address": None}}
    cluster = SLURMCluster(**how | asked.get("cluster", {}))
    for verb, given in asked["size"].items():
        getattr(cluster, verb)(**given)
    with cluster, Client(cluster) as client:
        if asked.get("wait"):
            client.wait_for_workers(asked["wait"])

        def watch() -> None:
            seen = -1
            while client.status == "running":
                now = len(cluster.scheduler_info["workers"])  # known here: to ask the scheduler would take its time
                if now != seen:
                    seen = now
                    tell(workers=now)
                time.sleep(0.2)

        threading.Thread(target=watch, daemon=True).start()
        for points in asked["points"]:
            for workers in asked.get("beside", []):
                begun = time.monotonic()
                sweep(points, workers=workers, **asked.get("how", {}))
                tell(threads=time.monotonic() - begun)
            try:
                begun = time.monotonic()
                tell(begun=True)
                cube = sweep(points, client=client, **asked.get("how", {}))
                tell(seconds=time.monotonic() - begun, hash=cube.attrs["values_sha256"])
            except KeyboardInterrupt:
                tell(stopped=True)
                ends, left = time.monotonic() + 1.0, 1
                while left and time.monotonic() < ends + asked.get("patience", 0.0):
                    time.sleep(max(0.1, ends - time.monotonic()))
                    answers = client.run(busy, on_error="return").values()  # a worker may leave just then
                    left = sum(each for each in answers if not isinstance(each, OSError))
                tell(busy=left)
            except dimersweep.errors.UserError as error:
                tell(error=str(error))
        ends = time.monotonic() + asked.get("linger", 0)
        while time.monotonic() < ends:
            time.sleep(0.2)
    tell(ended=True)


def main_of_mpi(asked: dict[str, Any]) -> None:
    """A sweep on the processes that mpirun has started."""
    import dask_mpi
    from distributed import Client

    dask_mpi.initialize(dashboard=False, nthreads=1)
    with Client() as client:
        cube = sweep(asked["points"], client=client, progress=False)
        tell(hash=cube.attrs["values_sha256"])


if __name__ == "__main__":
    given = json.loads(sys.argv[1])
    (main_of_mpi if given.get("mpi") else main)(given)

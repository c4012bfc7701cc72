"""Further attacks of ``faults.py``: on the workers, the scheduler and the driver of a cluster, and on the compile cache."""

import asyncio
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fault_attacks import flip, raising
from fault_scene import Hanging, Scene, attack, ended, forked, line_of, slowed

ROOT = Path(__file__).resolve().parents[2]

# --- clusters -----------------------------------------------------------------------------------------------------------


def serve(address: Path) -> None:
    """A scheduler."""
    from distributed import Scheduler

    async def until_the_end() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard=False, scheduler_file=str(address)) as made:
            await made.finished()

    asyncio.run(until_the_end())


def work(address: Path, before: Callable[[], None]) -> None:
    """A worker of one thread."""
    from distributed import Worker

    slowed()
    before()

    async def until_the_end() -> None:
        async with Worker(scheduler_file=str(address), nthreads=1, local_directory=str(address.parent)) as made:
            await made.finished()

    asyncio.run(until_the_end())


def impatient() -> None:
    """Have a client of this process give a scheduler up that does not answer for a second."""
    import dask

    dask.config.set({"distributed.comm.timeouts.connect": "1s", "distributed.client.heartbeat": "1s"})


class Cluster:
    """A scheduler, its workers and a driver, each a process by its number."""

    def __init__(self, scene: Scene, place: Path) -> None:
        self.scene, self.address = scene, place / "scheduler.json"
        self.told = place / "told"
        self.scheduler = forked(lambda: serve(self.address), self.told)
        self.workers: list[int] = []
        self.driver = 0

    def hire(self, before: Callable[[], None] = lambda: None) -> int:
        """A new worker."""
        self.workers.append(forked(lambda: work(self.address, before), self.told))
        return self.workers[-1]

    def start(self) -> int:
        """The driver."""
        self.driver = self.scene.start("--scheduler", self._address(), before=impatient)
        return self.driver

    def _address(self) -> str:
        """Where the scheduler is, as soon as it has written all of that."""
        ends = time.monotonic() + 60
        while time.monotonic() < ends:
            with suppress(OSError, ValueError):
                return str(json.loads(self.address.read_text())["address"])
            time.sleep(0.01)
        raise Hanging(f"there is no scheduler: {self.told.read_text()[-300:]}")

    def end(self) -> None:
        """End all that is left; that is no attack."""
        for process in (*self.workers, self.scheduler):
            with suppress(ProcessLookupError, ChildProcessError):
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)


@contextmanager
def cluster(scene: Scene, workers: int = 2) -> Iterator[Cluster]:
    """A cluster with so many workers."""
    with tempfile.TemporaryDirectory(dir=scene.stock.folder) as place:
        made = Cluster(scene, Path(place))
        try:
            for _ in range(workers):
                made.hire()
            yield made
        finally:
            made.end()


def at_any_moment(scene: Scene) -> None:
    """Wait for a moment of a sweep on a cluster."""
    time.sleep(scene.rng.uniform(0.1, 2.0))


@attack("cluster: nothing happens")
def _(scene: Scene) -> str | None:
    with cluster(scene) as made:
        return scene.came_through(made.start()) or (None if scene.cube.exists() else f"FAILED: {scene.told()[-300:]}")


@attack("cluster: a worker is killed")
def _(scene: Scene) -> str | None:
    with cluster(scene) as made:
        driver = made.start()
        at_any_moment(scene)
        scene.kill(made.workers[0])
        return scene.came_through(driver)


@attack("cluster: workers are killed and others come")
def _(scene: Scene) -> str | None:
    with cluster(scene) as made:
        driver = made.start()
        for _ in range(2):
            at_any_moment(scene)
            scene.kill(made.workers[-1])
            made.hire()
        return scene.came_through(driver)


@attack("cluster: the scheduler is killed")
def _(scene: Scene) -> str | None:
    with cluster(scene) as made:
        driver = made.start()
        at_any_moment(scene)
        scene.kill(made.scheduler)
        return scene.came_through(driver)


@attack("cluster: the driver is killed, and another one comes while the workers are at work")
def _(scene: Scene) -> str | None:
    with cluster(scene) as made:
        for _ in range(2):
            driver = made.start()
            at_any_moment(scene)
            scene.kill(driver)
        return scene.came_through(made.start())


@attack("cluster: the store is removed while workers are at work")
def _(scene: Scene) -> str | None:
    with cluster(scene) as made:
        driver = made.start()
        at_any_moment(scene)
        scene.tiles.unlink(missing_ok=True)
        return scene.came_through(driver)


def refused(scene: Scene, before: Callable[[], None], words: str) -> str | None:
    """A cluster with a worker that must not take part: the driver says so in one line, and makes no cube."""
    with cluster(scene, workers=1) as made:
        made.hire(before)
        time.sleep(1.0)
        code, told = ended(made.start()), scene.told()
    if code == 0 or words not in line_of(told) or scene.cube.exists():
        return f"FAILED: exit {code}: {told[-300:]}"
    return None


@attack("cluster: a worker has another version")
def _(scene: Scene) -> str | None:
    def pretend() -> None:
        from dimersweep.kernel.compiler import versions
        from dimersweep.work import scheduling

        versions.kernel_version = scheduling.kernel_version = lambda *code: "another"

    return refused(scene, pretend, "has another kernel")


@attack("cluster: a worker's compiled code is damaged")
def _(scene: Scene) -> str | None:
    def damage() -> None:
        from dimersweep.work import proving

        proving.PROVEN.clear()
        proving.run_many = raising

    return refused(scene, damage, "cannot run here (EOFError")


# --- the compile cache --------------------------------------------------------------------------------------------------

SMALL = """
import sys
from dimersweep.kernel.compiler.jit import exported

@exported
def total(n):
    found = 0.0
    for k in range(n):
        found += 1.0 / (1.0 + k) ** 2
    return found

if sys.argv[1:] == ["wait"]:
    print("ready", flush=True)
    sys.stdin.readline()
print(total(1000), len(total.dispatcher.stats.cache_hits), flush=True)
"""


def small(scene: Scene, wait: Callable[[], Any] | None = None) -> str:
    """What a small program says in a process of its own, whose compiled code is kept as that of the kernel is."""
    (scene.folder / "told").write_text(SMALL)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(scene.tiles), "PYTHONPATH": str(ROOT)}
    program = shutil.copy(scene.folder / "told", scene.tiles / "small.py")
    command = [sys.executable, str(program), *(["wait"] if wait else [])]
    with subprocess.Popen(command, env=environment, stdin=-1, stdout=-1, stderr=subprocess.STDOUT, text=True) as made:
        assert made.stdout is not None
        if wait:
            made.stdout.readline()
            wait()
        said, _ = made.communicate("\n", timeout=120)
    return said.strip() if made.returncode == 0 else f"exit {made.returncode}: {said}"


def codes(scene: Scene) -> list[Path]:
    """Files of compiled code."""
    return sorted(scene.tiles.glob("dimersweep/*/*.code"))


CACHE: dict[str, Callable[[Scene], Any]] = {
    "has 12 flipped bits": lambda scene: [flip(codes(scene)[0], scene.rng) for _ in range(12)],
    "is truncated": lambda scene: os.truncate(codes(scene)[0], scene.rng.randrange(1, codes(scene)[0].stat().st_size)),
    "is empty": lambda scene: os.truncate(codes(scene)[0], 0),
    "holds something else": lambda scene: codes(scene)[0].write_bytes(scene.rng.randbytes(5000)),
    "is removed": lambda scene: shutil.rmtree(scene.tiles / "dimersweep"),
    "is removed while it runs": lambda scene: shutil.rmtree(scene.tiles / "dimersweep"),
}
for _name, _damage in CACHE.items():

    @attack(f"the compile cache {_name}")
    def _(scene: Scene, name: str = _name, damage: Callable[[Scene], Any] = _damage) -> str | None:
        scene.tiles.mkdir()
        try:
            first = small(scene)
            if "while" not in name:
                damage(scene)
            again = small(scene, wait=(lambda: damage(scene)) if "while" in name else None)
            last = small(scene)
        finally:
            shutil.rmtree(scene.tiles)
        values = {said.split(" ")[0] for said in (first, again, last)}
        if len(values) != 1 or not first.startswith("1.64"):
            return f"FAILED: {first}, {again}, {last}"
        return "same" if last.endswith(" 1") else f"FAILED: it was not made again: {last}"

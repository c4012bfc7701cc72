"""Plays what happens to sweeps on a cluster, on a SLURM of three nodes of this host (``slurm_nodes.py``), and prints a table.

    python benchmarks/evidence/slurm.py                  all scenes: about a quarter of an hour on two cores
    python benchmarks/evidence/slurm.py --only adapt     those with this in their names
    python benchmarks/evidence/slurm.py --small          what CI plays: the recipe of the page and an array, less than a minute

It takes root, and Debian's packages slurm-wlm and munge, and for some scenes ``mpirun`` and pip; where something is missing, it
says what. It ends with the number of scenes that did not hold, or with 77 where no SLURM comes up; all
daemons are ended with it.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

from slurm_driver import sweep
from slurm_nodes import LeftOut, Slurm, slurm, why_not

import dimersweep

DRIVER = Path(__file__).with_name("slurm_driver.py")
LEFT_OUT = 77  # exit status where no SLURM comes up
SILENT, COMING = 70.0, 30.0  # seconds that nothing may be silent, and in which three jobs are to come
FEWEST, FEWER, FEW, SOME, MANY, ENDLESS = 300, 900, 1500, 4500, 10_000, 200_000  # points


class Driver:
    """A driver at work, what it tells, and what it prints: it makes a sweep of each of some numbers of points."""

    def __init__(self, there: Slurm, name: str, *points: int, **asked: Any) -> None:
        self.there, self.begun = there, time.time()
        self.folder = there.home / name
        self.folder.mkdir(exist_ok=True)
        there.own(self.folder)
        self.out = self.folder / "driver.txt"
        self.skip = self.out.stat().st_size if self.out.exists() else 0
        command = [str(there.python), str(DRIVER), json.dumps(asked | {"points": points})]
        self.process = there.start_as_user(*command, folder=self.folder, out=self.out)

    @property
    def text(self) -> str:
        """All that it has printed."""
        return self.out.read_bytes()[self.skip :].decode(errors="replace")

    @property
    def told(self) -> list[dict[str, Any]]:
        """What it has told."""
        return [json.loads(line) for line in self.text.splitlines() if line.startswith('{"at"')]

    def value(self, name: str) -> Any:
        """The last of what it has told by this name."""
        return next((each[name] for each in reversed(self.told) if name in each), None)

    @property
    def workers(self) -> list[int]:
        """How many workers there were, as they came and went."""
        return [each["workers"] for each in self.told if "workers" in each]

    def line(self, *words: str) -> str:
        """The first line that it has printed with all these words."""
        return next((line for line in self.text.splitlines() if all(word in line for word in words)), "")

    def wait_for(self, what: Callable[[], Any], seconds: float) -> Any:
        """What it comes to, within so many seconds."""
        ends = time.monotonic() + seconds
        while not (found := what()):
            if time.monotonic() > ends or self.process.poll() is not None:
                return what()
            time.sleep(0.1)
        return found

    def end(self, seconds: float = 240.0, number: int = 0) -> "Driver":
        """Wait until it has ended, after a signal if one is given."""
        if number and self.process.poll() is None:
            os.kill(self.process.pid, number)
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        return self

    def points(self) -> int:
        """How many points its lines of progress have told."""
        lines = [line for line in self.text.splitlines() if " points, " in line]
        return int(lines[-1].split("/")[0]) if lines else 0


class Came(NamedTuple):
    """What a scene came to: whether it held, in words, and whether the bits were the same ("" where there are none)."""

    held: bool
    words: str
    same: str = ""


def in_order(wanted: Sequence[int], counts: Sequence[int]) -> bool:
    """Whether some counts hold others, in their order."""
    left = iter(counts)
    return all(each in left for each in wanted)


class Bits(dict[int, str]):
    """The checksum of a sweep by threads, by its number of points; made where it is asked for, by one of those who ask."""

    making = Lock()

    def __missing__(self, points: int) -> str:
        with self.making:
            if points not in self:
                self[points] = sweep(points, progress=False).attrs["values_sha256"]
        return self[points]


Scene = Callable[[Slurm, Bits], Came]
SCENES: dict[str, tuple[str, Scene]] = {}
SMALL = ("small array", "recipe")


def scene(name: str, asked: str) -> Callable[[Scene], Scene]:
    """Enter a scene, with what is asked in it."""

    def enter(play: Scene) -> Scene:
        SCENES[name] = asked, play
        return play

    return enter


def same(driver: Driver, wanted: str) -> str:
    """Whether its cube has the bits of one made by threads."""
    return "yes" if driver.value("hash") == wanted else f"no ({driver.text[-300:]})"


ADAPT = {"adapt": {"maximum_jobs": 3}}
TWO = {"adapt": {"minimum_jobs": 2, "maximum_jobs": 2}}


@scene("lifetime", "workers that leave after 12 s, `adapt(minimum_jobs=2, maximum_jobs=2)`")
def _(there: Slurm, bits: Bits) -> Came:
    life = {"worker_extra_args": ["--lifetime", "12s", "--lifetime-stagger", "2s"]}
    made = Driver(there, "lifetime", MANY, size=TWO, cluster=life, how={"out": "cube.nc"}).end(400)
    healed = in_order((2, 1, 2), made.workers)
    words = f"finished; workers, as they came and went: {', '.join(map(str, made.workers))}"
    return Came(made.value("hash") is not None and healed, words, same(made, bits[MANY]))


def stopped(made: Driver, whose: str = "") -> tuple[float, bool, str]:
    """Press Ctrl-C: how long the driver takes [s], whether nobody computes then, or has a traceback in a log, and in words.

    Of the workers' tracebacks those count that name `whose`, such as the folder of the package.
    """
    begun = time.monotonic()
    made.process.send_signal(signal.SIGINT)
    made.wait_for(lambda: made.value("stopped"), 240)
    took = time.monotonic() - begun
    made.wait_for(lambda: made.value("busy") is not None, 240)
    logs = "".join(log.read_text(errors="replace") for log in (made.folder / "logs").iterdir())
    traces = [each for each in logs.split("Traceback")[1:] if whose in each] + made.text.split("Traceback")[1:]
    busy = made.value("busy")
    words = f"ended in {took:.1f} s; {busy} tasks at work; {len(traces)} tracebacks"
    return took, busy == 0 and not traces, " ".join([words, *(each[:2000] for each in traces)])


@scene("recipe", "the page's, `adapt(maximum_jobs=3)`: a job is cancelled, Ctrl-C, another sweep")
def _(there: Slurm, bits: Bits) -> Came:
    # nothing depends on the pace of the machine: there is work until all that is waited for was seen
    # one core each, and no quarter of a minute before dask asks for another one: what they compute meanwhile is for nothing
    lead = {"cores": 1, "job_script_prologue": ["export NUMBA_NUM_THREADS=1", "dimersweep warm"]}
    soon = {"distributed.deploy.lost-worker-timeout": "1 s"}
    made = Driver(there, "recipe", ENDLESS, FEWEST, size=ADAPT, cluster=lead, dask=soon, patience=240, linger=240)

    def workers_were(*counts: int) -> bool:
        """Whether there have been so many workers, one number after the other, within a time that any machine keeps."""
        return bool(made.wait_for(lambda: in_order(counts, made.workers), 240))

    three = workers_were(3) and made.wait_for(made.points, 240) > 0
    there.said("scancel", jobs_of(there)[0] if three else "")
    healed = workers_were(3, 2, 3)
    # dask has tracebacks of its own where a job is cancelled that starts, or that tells the scheduler of itself just then
    _, held, words = stopped(made, str(Path(dimersweep.__file__).parent))
    made.wait_for(lambda: made.value("hash"), 240)
    gone = workers_were(3, 2, 3, 0)
    made.end(number=signal.SIGKILL)
    held = three and healed and held and gone
    words = f"workers, as they came and went: {', '.join(map(str, made.workers))}; {words}"
    return Came(held, words if held else words + made.text[-3000:], same(made, bits[FEWEST]))


@scene("array", "`--array=1-20` of `run --part`, three of them killed and run again; `merge`")
def _(there: Slurm, bits: Bits) -> Came:
    return array(there, bits, SOME, 20, 3)


@scene("small array", "the same, of three parts, one of them killed")
def _(there: Slurm, bits: Bits) -> Came:
    return array(there, bits, FEWER, 3, 1)


def array(there: Slurm, bits: Bits, points: int, parts: int, most: int) -> Came:
    """A sweep of so many points and parts, of which some are killed and run again."""
    folder = there.home / f"array-{parts}"
    folder.mkdir()
    (folder / "sweep.toml").write_text(
        f'[sweep]\nperiods = 160\nstop_when_settled = false\noutput = "cube.nc"\n'
        f'[grid]\nbeta0 = {{start = 1, stop = 80, num = {points}, unit = "deg"}}\n'
    )
    there.own(folder)
    run = f"dimersweep run sweep.toml --part $SLURM_ARRAY_TASK_ID/{parts} --workers 1 --quiet"

    def submit(numbers: str) -> str:
        done = folder / "sbatch.txt"
        done.unlink(missing_ok=True)
        command = ["sbatch", "--parsable", f"--array={numbers}", "-n", "1", "-o", "%a.txt", "--wrap", run]
        there.start_as_user(*command, folder=folder, out=done).wait(30)
        return done.read_text().strip()

    def merge() -> str:
        out = folder / "merge.txt"
        out.unlink(missing_ok=True)
        files = sorted(map(str, folder.glob("cube.part-*.nc")))
        there.start_as_user(
            "dimersweep", "merge", *files, "--out", "cube.nc", "--no-plot", folder=folder, out=out
        ).wait(120)
        return out.read_text()

    job = submit(f"1-{parts}")
    killed: list[int] = []
    ends = time.monotonic() + 300
    while there.jobs(job) and time.monotonic() < ends:
        for number in range(2, parts + 1):
            begun = (folder / f"cube.part-{number}-of-{parts}.nc.tiles").exists()
            if begun and len(killed) < most and number not in killed:
                there.said("scancel", "--full", "--signal=KILL", f"{job}_{number}")
                killed.append(number)
        time.sleep(0.05)
    lacking = [number for number in killed if not (folder / f"cube.part-{number}-of-{parts}.nc").exists()]
    refused = merge()
    named = all(f"{number}/{parts}" in refused for number in lacking)
    job = submit(",".join(map(str, lacking)) or "1")
    while there.jobs(job) and time.monotonic() < ends:
        time.sleep(0.1)
    merged = merge()
    found = dimersweep.open_cube(folder / "cube.nc").attrs["values_sha256"] if (folder / "cube.nc").exists() else merged
    words = f"{len(lacking)} killed; merge refused and named them: {named}; then it made the cube"
    return Came(named and bool(lacking), words, "yes" if found == bits[points] else f"no ({found})")


def silent(there: Slurm, name: str, words: tuple[str, ...], **asked: Any) -> Came:
    """Nothing comes: how long there was no news when a line says so, with these words.

    News are what the driver prints, and workers that come and go: one that leaves may have sent results, of which no line told.
    """
    made = Driver(there, name, MANY, **asked)
    said: tuple[list[int], list[str]] = [], []
    since = made.begun

    def heard() -> str:
        nonlocal said, since
        line = made.line(*words)
        now = made.workers, [each for each in made.text.splitlines() if not each.startswith('{"at"')]
        if not line and now != said:
            said, since = now, time.time()
        return line

    line = made.wait_for(heard, SILENT + 60)
    took = time.time() - since
    made.end(number=signal.SIGKILL)
    return Came(bool(line) and took < SILENT, f"after {took:.0f} s: {line or made.text[-300:]}"[:260])


WAITING = {  # name: what is asked, the words of the line, and the cluster
    "pending": ("a partition that is down", ("no worker", "-p closed", "squeue --me"), {"queue": "closed"}, ADAPT),
    "no partition": ("a partition that does not exist", ("no worker", "-p absent"), {"queue": "absent"}, ADAPT),
    "too large": ("32 cores of nodes of 2", ("no worker", "cpus-per-task=32"), {"cores": 32}, ADAPT),
    "dies at once": (
        "a prologue that exits 1",
        ("no worker", "logs/dask-worker-"),
        {"job_script_prologue": ["exit 1"]},
        ADAPT,
    ),
    "scale": (
        "workers that leave after 10 s, `scale(jobs=1)`",
        ("have left", "adapt(minimum_jobs=n"),
        {"worker_extra_args": ["--lifetime", "10s"]},
        {"scale": {"jobs": 1}},
    ),
    # or the sweep ends, as points in a row could not be run: for the same reason
    "memory": ("workers of 160 MB", ("a worker takes 270 MB",), {"memory": "160MB"}, TWO),
}
for _name, (_asked, _words, _cluster, _size) in WAITING.items():

    @scene(_name, _asked)
    def _(
        there: Slurm,
        bits: Bits,
        how: tuple[Any, ...] = (_name.replace(" ", "-"), _words, _cluster, _size),
    ) -> Came:
        name, words, cluster, size = how
        return silent(there, name, words, cluster=cluster, size=size)


@scene("give up", "jobs that die at once, `give_up_after=20`")
def _(there: Slurm, bits: Bits) -> Came:
    die = {"job_script_prologue": ["exit 1"]}
    made = Driver(there, "give-up", FEW, size=ADAPT, cluster=die, how={"give_up_after": 20}).end(60)
    error = made.value("error") or made.text[-300:]
    return Came(error.startswith("given up: no result for 0:00:2"), error[:150])


def disturbed(name: str, there: Slurm, bits: Bits, disturb: Callable[[Driver], Any], **asked: Any) -> Came:
    """A sweep with an output that something happens to when it has begun; one that is not done then is begun again."""
    how: dict[str, Any] = {"size": TWO, "how": {"out": "cube.nc"}} | asked
    made = Driver(there, name, MANY, **how)
    made.wait_for(made.points, 60)
    words = disturb(made)
    made.end()
    again = 0
    while made.value("hash") is None and again < 3:
        again += 1
        made = Driver(there, name, MANY, **how).end()
    return Came(made.value("hash") is not None, f"{words}; begun again {again} times", same(made, bits[MANY]))


def jobs_of(there: Slurm) -> list[str]:
    """The jobs that run."""
    return there.said("squeue", "-h", "-t", "R", "-n", "dask-worker", "-o", "%i").split()


@scene("cancel", "`scancel` of a worker's job")
def _(there: Slurm, bits: Bits) -> Came:
    return disturbed("cancel", there, bits, lambda _: f"job {there.said('scancel', jobs_of(there)[0]) or 'cancelled'}")


@scene("requeue", "`scontrol requeue` of a worker's job")
def _(there: Slurm, bits: Bits) -> Came:
    return disturbed(
        "requeue", there, bits, lambda _: f"job {there.said('scontrol', 'requeue', jobs_of(there)[0]) or 'back'}"
    )


@scene("kill -9", "SIGKILL of the driver")
def _(there: Slurm, bits: Bits) -> Came:
    def kill(made: Driver) -> str:
        made.end(number=signal.SIGKILL)
        there.said("scancel", "--user", there.user.pw_name)
        return "killed"

    return disturbed("kill", there, bits, kill)


@scene("SIGTERM", "SIGTERM of the driver, as at its time limit")
def _(there: Slurm, bits: Bits) -> Came:
    def terminate(made: Driver) -> str:
        made.end(20, number=signal.SIGTERM)
        return f"ended with {made.process.returncode}, {'kept' if made.value('stopped') else made.text[-200:]}"

    return disturbed("term", there, bits, terminate)


@scene("time limit", "a time limit of a minute for workers' jobs")
def _(there: Slurm, bits: Bits) -> Came:
    # SLURM looks once a minute, so that a job may have two
    made = Driver(
        there,
        "limit",
        2 * MANY,
        size={"adapt": {"minimum_jobs": 1, "maximum_jobs": 1}},
        cluster={"walltime": "00:01:00"},
        how={"periods": 800},
    ).end(1200)
    comings = sum(count > 0 for count in made.workers)
    return Came(made.value("hash") is not None and comings > 1, f"finished; workers came {comings} times")


@scene("two drivers", "two drivers of one output")
def _(there: Slurm, bits: Bits) -> Came:
    how: dict[str, Any] = {"size": {"adapt": {"maximum_jobs": 1}}, "how": {"out": "cube.nc"}}
    one = Driver(there, "two", MANY, **how)
    one.wait_for(one.points, 60)
    other = Driver(there, "two", MANY, **how)
    other.out = one.out
    other.end(60)
    refused = "a sweep is at work here" in one.text
    one.end()
    return Came(refused, f"the second one was refused: {refused}", "yes" if bits[MANY] in one.text else "no")


@scene("another Numba", "a worker with another Numba")
def _(there: Slurm, bits: Bits) -> Came:
    place = there.home / "other"
    pip = [sys.executable, "-m", "pip", "install", "-q", "--target", str(place), "numba==0.67.0"]
    if subprocess.run(pip, check=False, capture_output=True, timeout=300).returncode:
        raise LeftOut("numba 0.67.0 cannot be installed")
    there.own(place)
    lead = {"job_script_prologue": [f"export PYTHONPATH={place}:$PYTHONPATH"]}
    made = Driver(there, "numba", SOME, size=ADAPT, cluster=lead).end(180)
    error = made.value("error") or made.text[-300:]
    finished = made.value("hash") is not None
    return Came(finished, "went on" if finished else error[:230], same(made, bits[SOME]))


@scene("mpirun", "`mpirun -n 4` with dask-mpi")
def _(there: Slurm, bits: Bits) -> Came:
    if shutil.which("mpirun") is None:
        raise LeftOut("there is no mpirun")
    folder = there.home / "mpi"
    folder.mkdir()
    there.own(folder)
    command = [
        "mpirun",
        "--oversubscribe",
        "-n",
        "4",
        str(there.python),
        str(DRIVER),
        json.dumps({"mpi": 1, "points": FEW}),
    ]
    quiet = {"DASK_LOGGING__DISTRIBUTED": "warning", "OMPI_MCA_btl_vader_single_copy_mechanism": "none"}
    there.start_as_user(*command, folder=folder, out=folder / "out.txt", **quiet).wait(240)
    text = (folder / "out.txt").read_text()
    return Came(
        bits[FEW] in text,
        f"{len(text.splitlines())} lines printed",
        "yes" if bits[FEW] in text else f"no ({text[-300:]})",
    )


@scene("stop", "Ctrl-C, 10,000 points; the workers are asked 1 s later")
def _(there: Slurm, bits: Bits) -> Came:
    # it lingers, since dask itself has tracebacks in the logs of workers where the cluster is closed
    made = Driver(there, "stop", MANY, size={"scale": {"jobs": 2}}, wait=2, linger=240)
    made.wait_for(made.points, 60)
    took, held, words = stopped(made)
    made.end(number=signal.SIGKILL)
    return Came(held and took < 3, words)


@scene("adapt", "`adapt(maximum_jobs=3)`, 10,000 points of 4 ms")
def _(there: Slurm, bits: Bits) -> Came:
    made = Driver(there, "adapt", MANY, size=ADAPT, linger=60)
    made.wait_for(lambda: made.value("hash"), 240)
    gone = made.wait_for(lambda: made.value("workers") == 0, 60)
    three = next((each["at"] for each in made.told if each.get("workers") == 3), None)
    made.end(number=signal.SIGKILL)
    held = three is not None and three < COMING and gone
    return Came(held, f"three jobs after {three} s; none at the end: {gone}", same(made, bits[MANY]))


@scene("throughput", "two workers of two threads, beside four threads; 10,000 points of 4 ms, three times each")
def _(there: Slurm, bits: Bits) -> Came:
    made = Driver(
        there,
        "throughput",
        *[MANY] * 3,
        size={"scale": {"jobs": 2}},
        wait=2,
        beside=[4],
        how={"progress": False, "periods": 280},  # a point takes 4 ms on a quiet core of 2026
    ).end(600)
    alone, cluster = ([each[name] for each in made.told if name in each] for name in ("threads", "seconds"))
    if len(alone) < 3 or len(cluster) < 3:
        return Came(False, made.text[-300:])
    ratios = sorted(a / c for a, c in zip(alone, cluster, strict=True))
    return Came(ratios[1] >= 0.95, f"{ratios[1]:.2f} of their pace (median of {', '.join(f'{r:.2f}' for r in ratios)})")


def played(name: str, there: Slurm, bits: Bits) -> tuple[bool, str]:
    """Play a scene: whether it held, and its line of the table."""
    asked, play = SCENES[name]
    try:
        came = play(there, bits)
    except LeftOut as reason:
        return True, f"| {name} | {asked} | left out: {reason} | |"
    except Exception as error:  # the other scenes are played all the same
        came = Came(False, f"{type(error).__name__}: {error}")
    held = came.held and not came.same.startswith("no")
    words = f"{'' if held else 'FAILED: '}{came.words}".replace("|", "/").replace("\n", " ")
    return held, f"| {name} | {asked} | {words} | {came.same} |"


def main() -> int:
    """Play scenes, and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", help="scenes with this in their names")
    parser.add_argument("--small", action="store_true", help="what CI plays")
    asked = parser.parse_args()
    chosen = SMALL if asked.small else [name for name in SCENES if name not in SMALL[:1] and asked.only in name]
    try:
        if why := why_not():
            raise LeftOut(why)
        return play_all(chosen, SMALL if asked.small else (*WAITING, "give up", "time limit"))
    except LeftOut as reason:
        print(f"slurm: left out: {reason}")
        return LEFT_OUT


def play_all(chosen: Sequence[str], together: Sequence[str]) -> int:
    """Play scenes, some of them at the same time, and print a line for each; how many did not hold."""
    failed, bits = 0, Bits()
    with (
        tempfile.TemporaryDirectory(prefix="slurm-", ignore_cleanup_errors=True) as place,
        slurm(Path(place) / "s") as there,
    ):
        Path(place).chmod(0o755)
        print("| scene | asked | came | same bits |\n|---|---|---|---|", flush=True)
        with ThreadPoolExecutor(len(together)) as pool:  # these wait most of their time
            waiting = {name: pool.submit(played, name, there, bits) for name in chosen if name in together}
        there.said("scancel", "--user", there.user.pw_name)
        for name in chosen:
            begun = time.monotonic()
            held, line = waiting[name].result() if name in waiting else played(name, there, bits)
            there.said("scancel", "--user", there.user.pw_name)
            failed += not held
            print(line, flush=True)
            print(f"{name}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())

"""What ``frozen.py`` asks of a revision, by its public names and its commands, and the answers as numbers and texts."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import same_states
import xarray as xr

from dimersweep import attractors, bifurcation, fit, load_run, loops, open_cube, orbits, refine, search, simulate, sweep
from dimersweep import stability as stabilities
from dimersweep.errors import OrbitError, ParameterError
from tests.checks.dimers import random_dimer
from tests.checks.questions import RUNS, questions

DECLARED = Path(__file__).resolve().parents[2] / "sweeps" / "borders"
EARLY = 4  # forcing periods after which a state is told besides the last one: no difference has grown much there
KINDS = [
    "fold",
    "flip",
    "stable_from",
    "stable_to",
    "word",
    "stick_slip",
    "lift_off",
    "double_impact",
    "chatter",
    "hop",
]
# what an answer took, what made it, and objects that it holds
LEFT_OUT = {"cost", "residual", "runs", "made_with", "kernel", "fixed", "creep", "slow_motion", "measured"}
NAMED_BEFORE = {"sequence": "word"}  # attributes, and their names in answers
OF_THE_PLACE = {
    *("history", "source", "kernel_version", "configuration_sha256", "values_sha256", "wall_time_s", "kernel_time_s"),
    *("git_commit", "git_dirty", "python", "numpy", "numba", "llvmlite", "cpu", "platform", "cost"),
}

Answer = dict[str, Any]


class Case(NamedTuple):
    """A question.

    Attributes
    ----------
    name : str
    make : callable
        Answers it; what it writes lies in the folder that it is given.
    read : callable, optional
        Answers it from what was written, in such a folder.
    go_on : callable, optional
        In place of `make` where a former revision has begun: goes on with what lies in the folder. Or the answer is
        ``{"refused": line}``.
    """

    name: str
    make: Callable[[Path], Answer]
    read: Callable[[Path], Answer] | None = None
    go_on: Callable[[Path], Answer] | None = None


def plain(value: Any) -> Any:
    """A value as JSON holds it, bit for bit."""
    if isinstance(value, xr.Dataset):
        return of_dataset(value)
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items() if name not in LEFT_OUT}
    if is_dataclass(value):
        named = {NAMED_BEFORE.get(each.name, each.name): each.name for each in fields(value) if each.name[0] != "_"}
        return plain({name: getattr(value, attribute) for name, attribute in named.items()})
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain([value.real, value.imag]) if np.iscomplexobj(value) else value.tolist()
    return value


def of_dataset(dataset: xr.Dataset) -> Answer:
    """The numbers of a dataset, flags as words, with their dimensions, types and units, and its attributes."""
    answer: Answer = {}
    for name, variable in dataset.variables.items():
        if name in LEFT_OUT:
            continue
        values, attrs = variable.values, variable.attrs
        kind = "text" if values.dtype.kind in "OU" else values.dtype.str
        if "flag_values" in attrs:
            words = dict(zip(np.atleast_1d(attrs["flag_values"]).tolist(), attrs["flag_meanings"].split(), strict=True))
            values = np.vectorize(lambda code, words=words: words.get(code, str(code)), otypes=[object])(values)
        answer[str(name)] = plain(values)
        answer[f"{name}, its kind"] = [*map(str, variable.dims), kind, str(attrs.get("units", ""))]
    told = {str(name): plain(value) for name, value in dataset.attrs.items() if name not in OF_THE_PLACE}
    if "configuration" in told:
        told["configuration"] = json.loads(told["configuration"])
        told["configuration"].pop("kernel_version", None)
    return answer | {"attributes": told}


# --- runs ----------------------------------------------------------------------------------------------------------


def numbers_of(run: Any) -> Answer:
    """The numbers of a run, and its last state."""
    answer = plain(run) | {"orbit": plain(run.orbit) if run.orbit else None}
    return answer | {"start": plain(run.start), "mode": run.mode}


def of_run(question: dict[str, Any], _: Path) -> Answer:
    """The numbers of a recorded run, its state after a few periods, and at its end."""
    run = simulate(**question["scene"] | {"record": True})
    answer = numbers_of(run)
    for name, t in (("early", min(EARLY / run.parameters["f"], run.duration)), ("end", run.duration)):
        try:
            answer[name] = plain(run.states([t]))
        except RuntimeError as reason:
            answer[name] = str(reason)
    return answer


def runs() -> Iterator[Case]:
    """The runs of ``same_bits.py``."""
    for k, question in enumerate(questions(RUNS)):
        scene = question["scene"]
        yield Case(f"run {k} of {scene['periods']} periods at rtol {scene['rtol']:.0e}", partial(of_run, question))


def verdicts() -> Iterator[Case]:
    """The cube of Fig. 7, of 2,697 points."""
    yield Case("Fig. 7", lambda _: plain(same_states.fig7(workers=1)))


# --- files ---------------------------------------------------------------------------------------------------------


def filed(name: str, ending: str, write: Callable[[Path], Any], read: Callable[[Path], Any]) -> Case:
    """A question whose answer is a file."""

    def reading(folder: Path) -> Answer:
        return plain(read(folder / f"{name}{ending}"))

    def make(folder: Path) -> Answer:
        write(folder / f"{name}{ending}")
        return reading(folder)

    return Case(f"{name}{ending}", make, reading)


QUIET: dict[str, Any] = {"progress": False, "workers": 1}
GRID = {"Gamma": [0.5, 0.9, 1.2], "beta0": {"start": 4, "stop": 84, "num": 9, "unit": "deg"}}
TURNED = {"e": [0.45, 0.55, 0.65], "Gamma": {"start": 0.75, "stop": 1.1, "num": 8}}
POINTS = {"e": [0.5, 0.6, 0.7, 0.6], "Gamma": [0.9, 1.0, 1.1, 0.7], "beta0": [0.1, 0.3, 0.5, 0.7]}
LOOP = {"Gamma": {"start": 0.7, "stop": 1.25, "step": 0.05}}, {"beta0": "16 deg"}
SEARCHED = {"Gamma": [0.5, 0.7, 0.9, 1.2], "f": [15, 20], "beta0": [0.1, 0.3, 0.5, 0.7, 0.9]}
PATHS = {"periods": 10, "per_period": 4}
COARSE = {
    "e": [0.4, 0.6, 0.8],
    "Gamma": [0.4, 0.8, 1.2, 1.6],
    "beta0": {"start": 4, "stop": 80, "num": 8, "unit": "deg"},
}
SWEEPS: dict[str, Callable[..., Any]] = {
    "sweep": partial(sweep, GRID, {"mu": 0.15}, periods=60),
    "strobes": partial(bifurcation, {"Gamma": [0.6, 0.9, 1.3, 1.8]}, periods=100, strobes=8),
    "certified": partial(sweep, GRID, periods=200, certify=True),
    "patient": partial(sweep, GRID, periods=30, max_periods=240, attrs={"title": "Patient", "note": [1, 2]}),
    "points": partial(sweep, points=POINTS, periods=60),
    "carried": partial(sweep, TURNED, carry="both", periods=60),
    "hysteresis": partial(sweep, TURNED, carry="both", periods=60, strobes=3),
}
IN_ZARR = {"sweep", "certified", "patient", "carried"}
SEARCHES: dict[str, Callable[..., Any]] = {
    "search": partial(search, SEARCHED, over="beta0", ask="first", periods=60, orbit_periods=30, paths=PATHS),
    "shares": partial(search, SEARCHED, over="beta0", ask="fraction", periods=60),
    "map": partial(refine, COARSE, over="beta0", periods=60, rtol=1e-6, halvings={"e": 1, "Gamma": 2}),
}


def cubes() -> Iterator[Case]:
    """Cubes of every kind, in each format that may hold them."""
    for name, make in (SWEEPS | SEARCHES).items():
        for ending in (".nc", ".zarr") if name in IN_ZARR else (".nc",):
            yield filed(name, ending, lambda path, make=make: make(out=path, **QUIET), open_cube)


def of_saved(path: Path) -> Answer:
    """The numbers of a saved run, its tables, and how it goes on."""
    run = load_run(path)
    answer = numbers_of(run) | {"on": numbers_of(run.go_on(20))}
    try:
        events = plain(run.events)
    except ParameterError:  # nothing was recorded
        return answer
    states = plain(run.states(np.linspace(0.0, run.duration, 40)))
    return answer | {"events": events, "states": states, "energy": plain(run.energy())}


STATE = {"beta": 0.2, "x1_rate": 0.3, "theta_rate": 0.4, "gamma_rate": 30.0}
SAVED: dict[str, Callable[[], Any]] = {
    "recorded": partial(simulate, periods=60),
    "unrecorded": partial(simulate, periods=60, record=False, beta0="30 deg", mu=0.3),
    "from-a-state": partial(simulate, start=STATE, periods=40, Gamma=1.1),
    "unlike-ends": partial(simulate, periods=40, r_1=5e-3, r_2=6e-3, e_1=0.5, e_2=0.7, Gamma_x=0.1, tilt=1e-3),
}


def saved() -> Iterator[Case]:
    """Saved runs."""
    for name, make in SAVED.items():
        yield filed(name, ".nc", lambda path, make=make: make().save(path), of_saved)


# --- tables --------------------------------------------------------------------------------------------------------


def command(*words: Any, folder: Path) -> "subprocess.CompletedProcess[str]":
    """A command of the program."""
    line = [sys.executable, "-m", "dimersweep", *map(str, words)]
    return subprocess.run(line, cwd=folder, check=False, capture_output=True, text=True)


def declared(path: Path, *, borders: str) -> None:
    """Make borders that a file declares."""
    done = command("borders", DECLARED / f"{borders}.toml", "--out", path.name, folder=path.parent)
    if done.returncode:
        raise RuntimeError(done.stderr)


STARTS = {"beta0": ("1 deg", "89 deg"), "phi0": (0.0, 6.28), "xdot0": (0.0, 1.0)}
BASE_ORBIT = partial(orbits.find, spin=100.0)
TABLES: dict[str, Callable[[], Any]] = {
    "loops": lambda: loops(sweep(*LOOP, carry="both", periods=200, **QUIET), within=1e-3),
    "branch": lambda: orbits.follow(BASE_ORBIT(), "Gamma", to=1.2, switch=True, points=20),
    "family": lambda: orbits.family(spin=(90.0, 150.0), points=8),
    "later": lambda: orbits.later(orbits.family(spin=(90.0, 150.0), points=8), spin=100.0, periods=200.0),
    "edge": lambda: orbits.edge("beta0", (0.24, 0.28)),
    "fit": lambda: fit({"path_radius": (4.06, 0.02)}, {"e": (0.55, 0.75)}),
    "section": lambda: simulate(periods=30).section("double_impact"),
    "energy by event": lambda: simulate(periods=30).energy("event"),
    "error": lambda: simulate(periods=60, stop_when_settled=True).error(),
    "multipliers": lambda: stabilities.multipliers(simulate(periods=300, stop_when_settled=True)),
    "lyapunov": lambda: stabilities.lyapunov(simulate(periods=100, Gamma=1.8), periods=100),
    "spectrum": lambda: stabilities.spectrum(simulate(periods=100, Gamma=1.8), periods=100),
    **{
        f"curve of {kind}": partial(orbits.border_curve, kind, "Gamma", "e", span=(0.55, 0.65), spin=100.0, points=12)
        for kind in ("fold", "flip", "hop")
    },
}


def tables() -> Iterator[Case]:
    """Tables; those that the program writes, as files."""
    for name, make in TABLES.items():
        yield Case(name, lambda _, make=make: {"table": plain(make())})
    census = partial(attractors, STARTS, starts=40, seed=1, over={"Gamma": [0.75, 0.95, 1.25]}, periods=300, **QUIET)
    yield filed("attractors", ".nc", lambda path: census(out=path), xr.load_dataset)
    for name in ("atlas-small", "branch-small", "families-small"):
        yield filed(name, ".nc", partial(declared, borders=name), xr.load_dataset)


# --- killed midway -------------------------------------------------------------------------------------------------

HEAD = '[sweep]\ntitle = "Half"\nperiods = 400\noutput = "{out}"\n'
DIPS = 'beta0 = {start = 4, stop = 80, num = 16, unit = "deg"}\n'
WIDE = "[grid]\nGamma = {start = 0.4, stop = 1.6, num = 10}\ne = {start = 0.4, stop = 0.8, num = 6}\n" + DIPS
CELLS = "[grid]\nGamma = {start = 0.4, stop = 1.6, num = 7}\ne = {start = 0.4, stop = 0.8, num = 5}\n" + DIPS
SLOW = "rtol = 1e-12\nstop_when_settled = false\n[grid]\n" + DIPS + "Gamma = {start = 0.5, stop = 1.6, num = 40}\n"
HALVES = {  # each takes some ten seconds
    "half-sweep.nc": SLOW,
    "half-sweep.zarr": SLOW,
    "half-carried.nc": 'carry = "both"\n' + SLOW,
    "half-search.nc": "rtol = 1e-12\n" + WIDE + '[search]\nover = "beta0"\nask = "fraction"\n',
    "half-map.nc": "rtol = 1e-12\n" + CELLS + '[search]\nover = "beta0"\n[refine]\nhalvings = {Gamma = 3, e = 1}\n',
}


class Half(NamedTuple):
    """A command whose output `out` is made, and one that says how far it is; ``{}`` stands for the output."""

    out: str
    make: tuple[str, ...]
    far: tuple[str, ...]
    begun: str  # what the second says once a part is kept
    read: Callable[[Path], Any]

    def whole(self, folder: Path) -> Answer:
        """The answer where the command comes to its end, else what it says."""
        done = command(*self.make, folder=folder)
        if done.returncode == 0:
            return plain(self.read(folder / self.out))
        last = (done.stderr.strip().splitlines() or [""])[-1]
        return {"crashed" if "Traceback" in done.stderr else "refused": last}

    def begin(self, folder: Path) -> Answer:
        """Begin it, and kill it when a part is kept; the answer that it would have come to."""
        line = [sys.executable, "-m", "dimersweep", *self.make]
        with subprocess.Popen(line, cwd=folder, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as at_work:
            while at_work.poll() is None and not re.search(self.begun, command(*self.far, folder=folder).stdout):
                time.sleep(0.1)
            at_work.kill()
        if at_work.returncode == 0 or (folder / self.out).exists():
            raise RuntimeError(f"{self.out}: was made before it was killed")
        with TemporaryDirectory() as other:
            for each in folder.glob("*.toml"):
                (Path(other) / each.name).write_text(each.read_text())
            answer = self.whole(Path(other))
        if answer.keys() & {"refused", "crashed"}:
            raise RuntimeError(f"{self.out}: {answer}")
        return answer


def half_of(out: str, text: str) -> Case:
    """A declared sweep that is killed."""
    file = f"{out}.toml"
    half = Half(out, ("run", file, "--no-plot", "--workers", "1"), ("status", out), r": [1-9]\d* of", open_cube)

    def make(folder: Path) -> Answer:
        (folder / file).write_text(HEAD.format(out=out) + text)
        return half.begin(folder)

    return Case(out, make, go_on=half.whole)


def halves() -> Iterator[Case]:
    """Sweeps, a search, a map and borders that were killed midway."""
    for out, text in HALVES.items():
        yield half_of(out, text)
    out, file = "half-borders.nc", str(DECLARED / "atlas-small.toml")
    made, far = ("borders", file, "--out", out), ("borders", file, "--out", out, "--plan")
    half = Half(out, made, far, "there already", xr.load_dataset)
    yield Case(out, half.begin, go_on=half.whole)


# --- borders -------------------------------------------------------------------------------------------------------


def of_border(kind: str, seed: int, _: Path) -> Answer:
    """What `border` gives for a random dimer."""
    dimer = random_dimer(seed)
    e = dimer.pop("e")
    try:
        found = orbits.border(kind, "Gamma", over={"e": [e]}, **dimer)
    except OrbitError:
        return {"found": False}
    return {"found": True} | plain(found.isel(e=0))


def borders(kinds: Sequence[str] = KINDS, dimers: int = 60) -> Iterator[Case]:
    """Borders of the random dimers of ``borders_random.py``."""
    for seed in range(dimers):
        for kind in kinds:
            yield Case(f"dimer {seed} {kind}", partial(of_border, kind, seed))


PARTS: dict[str, Callable[[], Iterator[Case]]] = {
    "runs": runs,
    "verdicts": verdicts,
    "cubes": cubes,
    "saved": saved,
    "tables": tables,
    "halves": halves,
    "borders": borders,
    "tori": partial(borders, ("torus",)),  # apart: most dimers have none, and to find that takes 20 s
}

"""One small file of each kind that the package writes, or that xarray writes of what the package returns."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import xarray as xr

from dimersweep import attractors, loops, observer, orbits, refine, search, simulate, sweep
from dimersweep.analysis.orbits import PeriodicOrbit
from dimersweep.runs.run import Run

BETA0 = {"start": 4, "stop": 86, "num": 42, "unit": "deg"}
QUIET = {"progress": False}


@observer(
    reached={"units": "m", "long_name": "greatest height of p2 over the plate, in \N{GREEK SMALL LETTER MU}m steps"},
    heights={
        "units": "m",
        "long_name": "height of p2",
        "along": {"name": "part", "values": [0.25, 0.5, 0.75], "units": "1", "long_name": "share of the last period"},
    },
)
def heights(run: Run) -> dict[str, object]:
    """Heights in the last period; of runs at high Gamma an error, for its text."""
    if run.parameters["Gamma"] > 1.2:
        raise ValueError(
            "no height of a dimer that jumps, in \N{GREEK SMALL LETTER MU}m: it is \N{DEGREE SIGN} of a text"
        )
    gaps = run.states([(run.n_periods - part) / run.parameters["f"] for part in (0.75, 0.5, 0.25)])["gap_2"].values
    return {"reached": gaps.max(), "heights": gaps}


@cache
def walk() -> Run:
    """The base case."""
    return simulate(periods=60)


@cache
def orbit() -> PeriodicOrbit:
    """Its orbit."""
    return orbits.find(guess=walk())


def table(make: Callable[[], xr.Dataset]) -> Callable[[Path], object]:
    """Write what `make` returns by xarray."""
    return lambda path: make().to_netcdf(path)


KINDS: dict[str, Callable[[Path], object]] = {
    "cube": lambda path: sweep({"f": [15, 20, 25], "beta0": BETA0}, periods=200, out=path, **QUIET),
    "cube in Zarr": lambda path: sweep({"f": [15, 20, 25], "beta0": BETA0}, periods=200, out=path, **QUIET),
    "cube of three axes": lambda path: sweep(
        {"f": [15, 20], "e": [0.6, 0.7, 0.8], "beta0": BETA0 | {"num": 5}},
        {"tilt": 0.001},
        periods=60,
        out=path,
        **QUIET,
    ),
    "cube of points": lambda path: sweep(
        points={"Gamma": [0.6, 0.9, 1.2, 1.4], "e": [0.6, 0.62, 0.66, 0.7]}, periods=60, out=path, **QUIET
    ),
    "cube with an observer": lambda path: sweep(
        {"Gamma": [0.6, 0.9, 1.4], "f": [15, 20]}, periods=60, observe=heights, out=path, **QUIET
    ),
    "cube of a search": lambda path: search(
        {"Gamma": [0.6, 0.9], "f": [15, 20], "beta0": BETA0 | {"num": 6}}, over="beta0", periods=60, out=path, **QUIET
    ),
    "refined map": lambda path: refine(
        {"Gamma": [0.6, 1.2], "f": [15, 20], "beta0": BETA0 | {"num": 6}},
        over="beta0",
        halvings={"Gamma": 2, "f": 1},
        periods=60,
        out=path,
        **QUIET,
    ),
    "carried cube": lambda path: sweep(
        {"f": [15, 20], "Gamma": [0.8, 0.9, 1.0]}, periods=60, carry="both", out=path, **QUIET
    ),
    "loops": table(lambda: loops(sweep({"f": [15, 20], "Gamma": [0.7, 0.8, 0.9]}, periods=60, carry="both", **QUIET))),
    "borders": table(lambda: orbits.border("fold", "Gamma", over={"e": [0.6, 0.61, 0.62]}, start=orbit())),
    "border curve": table(lambda: orbits.border_curve("fold", "Gamma", "e", span=(0.6, 0.602), start=orbit())),
    "branch": table(lambda: orbits.follow(orbit(), "Gamma", to=0.91)),
    "family": table(lambda: orbits.family(spin=(0.0, 20.0), points=3)),
    "sustained spins": table(lambda: orbits.sustained(spin=(0.0, 300.0))),
    "attractors": lambda path: attractors(
        {"beta0": (0.2, 0.6)}, starts=4, over={"e": [0.6, 0.61]}, periods=120, out=path, **QUIET
    ),
    "run": lambda path: walk().save(path),
    "events": table(lambda: walk().events),
    "states": table(lambda: walk().states([k / 600 for k in range(61)])),
    "energy": table(lambda: walk().energy()),
}


def write(kind: str, folder: Path) -> Path:
    """Write the file of a kind into a folder, unless it is there."""
    path = folder / f"{kind.replace(' ', '_')}{'.zarr' if kind.endswith('Zarr') else '.nc'}"
    if not path.exists():
        folder.mkdir(exist_ok=True, parents=True)
        KINDS[kind](path)
    return path

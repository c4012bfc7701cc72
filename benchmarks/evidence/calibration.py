"""How far the trust that a run or a sweep tells can be trusted: ``python benchmarks/evidence/calibration.py --scenes 5000``.

Random scenes around the paper's, from four forcing periods to sixty (where many are chaotic). The bounds of `Run.error` are
compared with the differences to the same runs at rtol 1e-13; the certified verdicts of longer runs with those from rtol
1e-6 to 1e-12. Prints both and draws the bounds over the true errors.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dimersweep import Parameters, simulate
from dimersweep.cubes.cube import FLAGS, blank
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import CODES, MODES
from dimersweep.runs.shadows import (
    CERTAIN,
    FINEST_SHADOW,
    certified,
    delays,
    difference,
    scaled,
)
from dimersweep.runs.solving import RunSettings

FIGURE = Path(__file__).resolve().parents[2] / "docs" / "figures" / "calibration.png"
LENGTHS = (4, 4, 20, 60)  # forcing periods, in turns
SAMPLES = 4  # states compared per period
VERDICT_PERIODS = 200
RTOL = 1e-8
RTOLS = tuple(10.0**-k for k in range(6, 13))
CHUNK = 20  # scenes to a task
COLORS = {4: "#0072b2", 20: "#e69f00", 60: "#009e73"}


def scene(seed):
    """Parameters of one random scene; every second one has the paper's dimer and start, but for e, Gamma, f and beta0."""
    rng = np.random.default_rng([20240607, seed])
    if seed % 2:
        drawn = {"e": (0.4, 0.9), "Gamma": (0.6, 1.3), "f": (15, 35), "beta0": (0.02, 1.5)}
        return {name: float(rng.uniform(*ends)) for name, ends in drawn.items()}
    drawn = {"e": (0.2, 0.9), "Gamma": (0.5, 3), "f": (10, 40), "A_r": (2.5, 8), "mu": (0.02, 0.6)}
    drawn |= {"beta0": (0.02, 1.5), "xdot0": (0, 2), "phi0": (0, 6.28)}
    given = {name: float(rng.uniform(*ends)) for name, ends in drawn.items()}
    return given | {"mu_s": given["mu"] * float(rng.uniform(1, 2))}


def error_of(seed, rtol):
    """Length, true error and bound of the states, the same of the event times (in periods), share of events found.

    Where not all errors of a run are bounded, true error and bound are those of the moment where the bound fails by most.
    """
    given, periods = scene(seed), LENGTHS[seed // 2 % len(LENGTHS)]
    run = simulate(**given, periods=periods, rtol=rtol)
    finest = simulate(**given, periods=periods, rtol=FINEST_SHADOW)
    if run.status != "ok" or finest.status != "ok":
        return None
    bound = run.error(np.arange(SAMPLES * periods + 1) / (SAMPLES * given["f"]))
    times = bound["time"].values
    late, late_bound = delays(run, finest), bound["event_time"].values
    found = ~np.isnan(late + late_bound)
    pairs = (scaled(difference(run, finest, times)), bound["scaled"].values), (late[found], late_bound[found])
    worst = []
    for true, told in pairs:
        k = np.argmax(true / told) if (true > told).any() else np.argmax(true)
        worst += [true[k], told[k]]
    return np.array([periods, *worst[:2], *(given["f"] * np.array(worst[2:])), found.mean()])


def verdicts_of(seeds):
    """Confidence of the verdicts at `RTOL`, modes at each of `RTOLS`, shapes (n,), (n, 7); times without and with it [s]."""
    rows = np.array([Parameters(**scene(seed)).row() for seed in seeds])
    began = time.perf_counter()
    out, codes = blank(len(rows))
    run_many(rows, VERDICT_PERIODS, RTOL, True, out, codes)
    plain = time.perf_counter() - began
    confidence, _ = certified(rows, RunSettings(VERDICT_PERIODS, VERDICT_PERIODS, RTOL), out, codes)
    spent = time.perf_counter() - began
    modes = []
    for rtol in RTOLS:
        out, codes = blank(len(rows))
        run_many(rows, VERDICT_PERIODS, rtol, True, out, codes)
        modes.append(codes[:, CODES.index("mode")])
    return confidence, np.array(modes).T, plain, spent


def tell_errors(errors, seconds):
    """Print how often the bounds hold, and how wide they are."""
    print(f"{len(errors)} runs at rtol {RTOL:.0e} against rtol {FINEST_SHADOW:.0e}, {seconds:.0f} s")
    print("periods   runs  bound holds  bound/error: median   90 %  true error: median   90 %   what")
    for periods in (*sorted(set(LENGTHS)), "all"):
        some = errors if periods == "all" else errors[errors[:, 0] == periods]
        for what, k in (("states", 1), ("events", 3)):
            true, told = some[:, k], some[:, k + 1]
            ratio = told / np.maximum(true, 1e-300)
            print(
                f"{periods!s:>7}  {len(some):5d}  {100 * np.mean(true <= told):9.2f} %  {np.median(ratio):19.1f}"
                f"  {np.quantile(ratio, 0.9):5.0f}  {np.median(true):18.1e}  {np.quantile(true, 0.9):.0e}   {what}"
            )
    print(f"events that a shadow lacks: {100 * np.mean(1 - errors[:, 5]):.1f} % of a run in the mean")


def tell_verdicts(confidence, modes, plain, spent, seconds):
    """Print how many verdicts are certified, and how many change with rtol."""
    change = (modes != modes[:, :1]).any(axis=1)
    print(
        f"{len(modes)} verdicts after up to {VERDICT_PERIODS} periods, {seconds:.0f} s; "
        f"a certified sweep takes {spent / plain:.1f} times as long as another one"
    )
    for code, name in enumerate(FLAGS["confidence"]):
        some = confidence == code
        if some.any():
            told = ", ".join(
                f"{MODES[m]} {n}" for m, n in zip(*np.unique(modes[some, 2], return_counts=True), strict=True)
            )
            print(
                f"{name:>9}: {100 * some.mean():6.2f} % of the points, of which {100 * change[some].mean():.3f} % "
                f"({np.count_nonzero(change & some)}) change over rtol 1e-6 to 1e-12 ({told})"
            )
    certain = confidence == CERTAIN
    print(f"certified verdicts that do not change: {100 * (1 - change[certain].mean()):.3f} %")


def draw(errors, path):
    """Bounds over true errors, of states and of event times."""
    figure = Figure(figsize=(9, 4.4), layout="constrained")
    axes = figure.subplots(1, 2)
    labels = ("error of the state, in its scales", "error of an event's time, in periods")
    for ax, k, label in zip(axes, (1, 3), labels, strict=True):
        true, told = np.maximum(errors[:, k], 1e-16), errors[:, k + 1]
        for periods, color in COLORS.items():
            some = errors[:, 0] == periods
            ax.loglog(true[some], told[some], ".", ms=3, color=color, alpha=0.5, label=f"{periods} periods")
        ends = np.array([true.min(), max(true.max(), told[np.isfinite(told)].max())])
        ax.loglog(ends, ends, "k-", lw=1, label="bound = error")
        ax.loglog(ends, 100 * ends, "k--", lw=1, label="100 times that")
        ax.set_xlabel(f"true {label}")
        ax.set_ylabel("estimated bound")
        ax.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.suptitle(f"{len(errors)} runs at rtol {RTOL:.0e}, against rtol {FINEST_SHADOW:.0e}", fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=200)


def main():
    """Print the tables, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200, help="number of random scenes")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--figure", type=Path, default=FIGURE, help="where the figure goes")
    options = parser.parse_args()
    simulate(periods=1)  # compiled once, before the processes start
    with ProcessPoolExecutor(options.workers) as pool:
        began = time.perf_counter()
        found = pool.map(partial(error_of, rtol=RTOL), range(options.scenes), chunksize=CHUNK)
        errors = np.array([row for row in found if row is not None])
        tell_errors(errors, time.perf_counter() - began)
        began = time.perf_counter()
        chunks = np.array_split(np.arange(options.scenes), max(1, options.scenes // CHUNK))
        parts = list(zip(*pool.map(verdicts_of, chunks), strict=True))
    tell_verdicts(
        *(np.concatenate(part) for part in parts[:2]), sum(parts[2]), sum(parts[3]), time.perf_counter() - began
    )
    draw(errors, options.figure)
    print(options.figure)


if __name__ == "__main__":
    main()

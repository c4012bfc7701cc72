"""Random scenes over the whole domain of the model, counted and examined: ``python benchmarks/evidence/stress.py 1000000``.

Every scene is run to its verdict; some are run again with their record, the odd ones among them, to measure how deep an end
is ever below the plate, how much energy comes from nothing, and whether a slip turns round at an event (``examine.py``).
The last table has the worst of each with the number of its scene. A kind of scene that fails is made simple (fewest
periods, fewest decimals) and printed as a case for ``tests/kernel/test_stress_cases.py``.
"""

import argparse
import json
import os
import platform
import signal
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numba
import numpy as np
from matplotlib.figure import Figure

from dimersweep.kernel.model.layout import (
    MODES,
    N_CODES,
    OK,
    STATUSES,
)
from dimersweep.parameters import Parameters
from tests.checks.examine import CODE, GAINED, KINDS, SUNK, examine, lies
from tests.checks.random_scenes import (
    BLOCK,
    LONGEST,
    SAWS,
    base,
    faults,
    lying_nan,
    parameters_of,
    rows_of,
    run_block,
    scene_row,
)

FIGURE = Path(__file__).resolve().parents[2] / "docs" / "figures" / "stress.png"
MANY, SLOW = 60, 20  # scenes with the most events, and slowest ones, that are examined besides
BOUNDS = ("max_events", "impact_steps", "contact_steps", "root_steps", "stopped")  # statuses that stand for a hang
TASK = 50  # scenes to a task of the examination
BUSY = 1000  # work, in hops of one end, from which a scene's time says what a hop costs
PATIENCE = 20.0  # time for making one scene simple, or for examining its record [s]


# --- failing scenes made simple ---------------------------------------------------------------------------------------


def allowed(scene):
    """Whether the model allows these parameters."""
    try:
        Parameters(**scene)
    except ValueError:
        return False
    return True


def minimise(scene, periods, rtol, fault):
    """The simplest scene found with the same fault: fewest periods, then values of the base case or of fewest decimals.

    The search ends after `PATIENCE` seconds with what it has found.

    Parameters
    ----------
    scene : dict
        Keywords of ``simulate``.
    fault : str
        One of its `faults`.

    Returns
    -------
    scene, periods
    """

    end = time.perf_counter() + PATIENCE

    def fails(trial, n):
        in_time = time.perf_counter() < end
        return in_time and allowed(trial) and fault in faults(trial, n, rtol, examined=fault not in STATUSES)

    while True:
        before = dict(scene), periods
        periods = next((n for n in range(1, periods) if fails(scene, n)), periods)
        for name in list(scene):
            simple = next(
                (value for value in simpler(base(scene, name), scene[name]) if fails(scene | {name: value}, periods)),
                None,
            )
            if simple is not None:
                scene = scene | {name: simple}
        if (scene, periods) == before:
            return {name: value for name, value in scene.items() if value != base(scene, name)}, periods


def simpler(usual, value):
    """Values simpler than this one, the simplest, the usual one, first."""
    tries = [usual] + [float(f"{value:.{digits}g}") for digits in range(1, 17)]
    return tries[: tries.index(value)] if value in tries else tries


# --- the whole suite --------------------------------------------------------------------------------------------------


def teller(total, what):
    """A function that prints how many are done, and the time it took, at about every tenth of them."""
    begun, shown = time.perf_counter(), 0

    def told(done):
        nonlocal shown
        if done - shown >= total / 10:
            shown = done
            print(f"... {done} of {total} {what} in {time.perf_counter() - begun:.0f} s", flush=True)

    return told


def survey(n, seed, domain, periods, rtol, workers, told=lambda done: None):
    """Run all scenes: codes, lying nans, seconds and work, shape (n, ...), and the time that passed."""
    blocks = range(-(-n // BLOCK))
    codes, nans, seconds, work = np.zeros((n, N_CODES), np.int64), np.zeros(n, bool), np.zeros(n), np.zeros(n)

    def run(block):
        rows = rows_of(block, min(BLOCK, n - block * BLOCK), seed, domain)
        return block, len(rows), run_block(rows, periods, rtol)

    run_block(rows_of(0, 1, seed, "near"), 1, rtol)  # compiles
    begun = time.perf_counter()
    with ThreadPoolExecutor(workers) as pool:
        for block, size, (found, out, taken, done) in pool.map(run, blocks):
            here = slice(block * BLOCK, block * BLOCK + size)
            codes[here], nans[here], seconds[here], work[here] = found, lying_nan(found, out), taken, done
            told(here.stop)
    return codes, nans, seconds, work, time.perf_counter() - begun


def chosen(codes, seconds, examined):
    """Numbers of the scenes that are run again with their record: every so manieth, and odd ones that finished; none of 0."""
    if not examined:
        return []
    ok = codes[:, CODE["status"]] == OK
    some = np.linspace(0, len(codes), min(examined, len(codes)), endpoint=False).astype(int)
    many, slow = np.argsort(codes[:, CODE["n_events"]] * ok)[-MANY:], np.argsort(seconds * ok)[-SLOW:]
    numbers = np.unique(np.concatenate([some, many, slow]))
    return numbers[ok[numbers]].tolist()


def look(k, options):
    """Examination of scene number k; None if it takes longer than `PATIENCE`."""

    def end(*_):
        raise TimeoutError

    signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        return examine(scene_row(k, options.seed, options.domain), options.periods, options.rtol)
    except TimeoutError:
        return None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def examination(numbers, options):
    """What the records of these scenes show, by number, without those that are too long; and the time that passed."""
    begun, told, looks = time.perf_counter(), teller(len(numbers), "records"), {}
    with ProcessPoolExecutor(options.workers) as pool:
        found = pool.map(partial(look, options=options), numbers, chunksize=TASK)
        for done, (k, seen) in enumerate(zip(numbers, found, strict=True), 1):
            if seen is not None:
                looks[k] = seen
            told(done)
    return looks, time.perf_counter() - begun


def failures(codes, looks, options):
    """Scenes with a fault made simple, at most `per_kind` of each fault."""
    faulty = {}
    for k in np.flatnonzero(codes[:, CODE["status"]] != OK):
        faulty.setdefault(STATUSES[codes[k, CODE["status"]]], []).append(int(k))
    for k, seen in looks.items():
        for fault in lies(seen):
            faulty.setdefault(fault, []).append(k)
    found = []
    for fault, numbers in faulty.items():
        for k in numbers[: options.per_kind]:
            scene = parameters_of(scene_row(k, options.seed, options.domain))
            scene, periods = minimise(scene, options.periods, options.rtol, fault)
            found.append({"parameters": scene, "fault": fault, "periods": periods, "rtol": options.rtol, "number": k})
    return found


def machine(workers):
    """The computer, in words."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    cpu = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())
    return f"{cpu}, {os.cpu_count()} cores, {workers} at work, {platform.system()}, numba {numba.__version__}"


def worst(looks, measure):
    """The largest `measure` of the examined scenes, and the number of its scene."""
    k = max(looks, key=lambda k: measure(looks[k]), default=None)
    return (0.0, None) if k is None else (float(measure(looks[k])), int(k))


def acceptance(codes, nans, seconds, looks):
    """What is asked of the engine: each with its value, the most it may be, and the numbers of the worst scenes."""
    status = codes[:, CODE["status"]]
    hung = np.isin(status, [STATUSES.index(name) for name in BOUNDS])
    lying = [
        *np.flatnonzero(nans).tolist(),
        *(k for k, seen in looks.items() if seen["nan"] and seen["status"] == "ok"),
    ]
    deep, deepest = worst(looks, lambda seen: seen["penetration"] / seen["length"])
    lines = {
        "hangs: bounds on events or steps, in 10,000": (1e4 * hung.mean(), 1.0, np.flatnonzero(hung)[:5].tolist()),
        "time of the slowest [s]": (float(seconds.max()), LONGEST, [int(seconds.argmax())]),
        "nan with status ok": (len(lying), 0, lying[:5]),
        "penetration over length": (deep, SUNK, [deepest]),
    }
    for kind in KINDS:
        gain, most = worst(looks, lambda seen, kind=kind: seen["nothing"][kind])
        lines[f"energy from nothing, {kind}"] = (gain, GAINED, [most])
    return lines


def cost_of_work(seconds, work):
    """Time for each hop's worth of work [s]: of all scenes, the most of one with some work, and of the slowest."""
    busy = np.flatnonzero(work >= BUSY)
    most = busy[np.argmax(seconds[busy] / work[busy])] if len(busy) else int(np.argmax(seconds))
    slowest = int(np.argmax(seconds))
    each = {name: (seconds[k] / work[k], int(k)) for name, k in (("most", most), ("slowest", slowest))}
    return {"all": seconds.sum() / work.sum(), "busy": len(busy)} | each


def counted(codes, words):
    """How many scenes have each word that occurs."""
    return {word: int((codes == k).sum()) for k, word in enumerate(words) if (codes == k).any()}


def summary(codes, nans, seconds, work, times, looks, options):
    """Everything counted, as JSON can hold it."""
    n = len(codes)
    status, mode, events = (codes[:, CODE[name]] for name in ("status", "mode", "n_events"))
    slowest = np.argsort(seconds)[::-1][:5]
    return {
        "scenes": n,
        "seed": options.seed,
        "domain": options.domain,
        "periods": options.periods,
        "rtol": options.rtol,
        "machine": machine(options.workers),
        "seconds": times,
        "status": counted(status, STATUSES),
        "mode": counted(mode, MODES),
        "most_events": int(events.max()),
        "most_events_per_period_ok": float(events[status == OK].max(initial=0) / options.periods),
        "slowest": [{"number": int(k), "seconds": seconds[k], "status": STATUSES[status[k]]} for k in slowest],
        "cost_of_work": cost_of_work(seconds, work),
        "examined": len(looks),
        "above": {
            what: {kind: sum(seen[what][kind] > GAINED for seen in looks.values()) for kind in KINDS}
            for what in ("gain", "nothing")
        },
        "sinks": sum(seen["penetration"] > SUNK * seen["length"] for seen in looks.values()),
        "gain": {kind: worst(looks, lambda seen, kind=kind: seen["gain"][kind]) for kind in KINDS},
        "doubt": worst(looks, lambda seen: seen["doubt"]),
        "flips": sum(seen["flips"] for seen in looks.values()),
        "dip": worst(looks, lambda seen: seen["dip"]),
        "crowd": worst(looks, lambda seen: seen["crowd"]),
        "acceptance": acceptance(codes, nans, seconds, looks),
    }


def tell(report):
    """Print the tables."""
    n, times = report["scenes"], report["seconds"]
    print(
        f"{n} scenes ({report['domain']}, seed {report['seed']}), {report['periods']} periods, rtol {report['rtol']:.0e}"
    )
    print(f"{'machine':>30}: {report['machine']}")
    print(
        f"{'time':>30}: {times['runs']:.0f} s for all runs ({n / times['runs']:.0f} a second), {times['records']:.0f} s for the"
        f" records of {report['examined']} of them"
    )
    for title in ("status", "mode"):
        print(f"{title:>30}: " + ", ".join(f"{name} {count}" for name, count in report[title].items()))
    print(
        f"{'most events':>30}: {report['most_events']}; per period of an ok run {report['most_events_per_period_ok']:.0f}"
    )
    told = (f"{1e3 * s['seconds']:.0f} ms (scene {s['number']}, {s['status']})" for s in report["slowest"])
    print(f"{'slowest':>30}: " + ", ".join(told))
    cost = report["cost_of_work"]
    told = f"{1e6 * cost['all']:.2f} us of all scenes, {1e6 * cost['slowest'][0]:.2f} us of the slowest one"
    most = (
        f"{1e6 * cost['most'][0]:.2f} us at most (scene {cost['most'][1]}) of {cost['busy']} with {BUSY} hops or more"
    )
    print(f"{'time for a hop of work':>30}: {told}, {most}")
    for kind, (gain, k) in report["gain"].items():
        count, left = (report["above"][what][kind] for what in ("gain", "nothing"))
        print(
            f"{'energy gained, ' + kind:>30}: {gain:.1e} (scene {k}), above {GAINED:.0e} in {count}; with more digits in {left}"
        )
    print(f"{'doubt about that, in contact':>30}: {report['doubt'][0]:.1e} at most")
    print(f"{'scenes that sink':>30}: {report['sinks']}")
    print(f"{'largest dip':>30}: {report['dip'][0]:.4f} rad (scene {report['dip'][1]})")
    print(f"{'slips that flip':>30}: {report['flips']}")
    print(f"{'most event rows at one moment':>30}: {report['crowd'][0]:.0f} (scene {report['crowd'][1]})")
    print(f"{'what is asked':>45}    found    asked  scenes")
    for name, (value, most, scenes) in report["acceptance"].items():
        sign = "<" if most else "="
        print(f"{name:>45} {value:8.2g}  {sign} {most:.0e}  {scenes}")


def draw(codes, seconds, looks, report, path):
    """Four pictures: what became of the scenes, how long they took, how many events, and what the records show."""
    blue, orange, grey, green, pink = "#0072b2", "#d55e00", "#999999", "#009e73", "#cc79a7"
    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, 2)
    ok = codes[:, CODE["status"]] == OK
    names = [*report["mode"], *(name for name in report["status"] if name != "ok")]
    counts = [report["mode"].get(name, report["status"].get(name)) for name in names]
    colors = [blue if name in report["mode"] and name != "failed" else orange for name in names]
    axes[0, 0].barh(names[::-1], counts[::-1], color=colors[::-1])
    axes[0, 0].set_xscale("log")
    axes[0, 0].set_xlim(left=0.5)
    axes[0, 0].set_xlabel(f"scenes of {report['scenes']:,}")
    axes[0, 0].set_title("modes, and why runs failed")
    for ax, values, label in (
        (axes[0, 1], 1e3 * seconds, "time of a scene [ms]"),
        (axes[1, 0], np.maximum(codes[:, CODE["n_events"]], 0.5) / report["periods"], "events per forcing period"),
    ):
        edges = np.geomspace(max(values.min(), 1e-3), values.max() * 1.001, 60)
        ax.hist(values[ok], edges, color=blue, label="ok")
        if not ok.all():
            ax.hist(values[~ok], edges, color=orange, label="failed", histtype="step", lw=1.5)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_xlabel(label)
        ax.set_ylabel("scenes")
        ax.legend()
    seen = list(looks.values())
    lines = {"penetration over length": ([shown["penetration"] / shown["length"] for shown in seen], grey)}
    lines |= {
        f"energy gained, {kind}": ([shown["gain"][kind] for shown in seen], color)
        for kind, color in zip(KINDS, (blue, orange, green, pink), strict=True)
    }
    for name, (values, color) in lines.items():
        axes[1, 1].step(np.sort(np.maximum(values, 1e-18))[::-1], np.arange(1, len(seen) + 1), color=color, label=name)
    axes[1, 1].axvline(1e-9, color="black", ls="--", lw=1)
    axes[1, 1].set_xscale("log")
    axes[1, 1].set_yscale("log")
    axes[1, 1].set_xlabel("at least this (dashed: 1e-9)")
    axes[1, 1].set_ylabel(f"scenes of {len(seen):,} recorded")
    axes[1, 1].legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=2, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=200)


def main():
    """Run, count, examine, make failures simple, tell and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--domain", choices=("near", "far", "mixed", "wider", "wild", "whole", *SAWS), default="whole")
    parser.add_argument("--periods", type=int, default=10)
    parser.add_argument("--rtol", type=float, default=1e-8)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument(
        "--examined", type=int, default=20_000, help="scenes whose records are examined, besides odd ones"
    )
    parser.add_argument("--per-kind", type=int, default=2, help="failing scenes of each kind that are made simple")
    parser.add_argument("--out", type=Path, help="JSON file of the counts and the failing scenes")
    parser.add_argument("--figure", type=Path, default=FIGURE, help="where the figure goes")
    options = parser.parse_args()
    told = teller(options.scenes, "scenes")
    codes, nans, seconds, work, wall = survey(
        options.scenes, options.seed, options.domain, options.periods, options.rtol, options.workers, told
    )
    print(counted(codes[:, CODE["status"]], STATUSES), flush=True)
    numbers = chosen(codes, seconds, options.examined)
    looks, records = examination(numbers, options)
    print(f"{len(numbers) - len(looks)} of {len(numbers)} records took too long to be examined", flush=True)
    report = summary(codes, nans, seconds, work, {"runs": wall, "records": records}, looks, options)
    tell(report)
    draw(codes, seconds, looks, report, options.figure)
    print(options.figure, flush=True)
    found = failures(codes, looks, options)
    for case in found:
        print(case)
    if options.out:
        options.out.write_text(json.dumps(report | {"failures": found}, indent=1))


if __name__ == "__main__":
    main()

"""Speed of the engine and of its verbs: ``python benchmarks/speed.py``.

Forcing periods a second in the drift of the base case, the time of each verb in a compiled loop, the time to compile
and to start from the cache, and the time of the sweep of Fig. 7.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numba import njit

from dimersweep import declaration, simulate, sweep
from dimersweep.kernel import body, charts, contact, flight, impact, roots
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.body import TWO_PI
from dimersweep.kernel.engine import WORK_COLUMNS, WORK_ROWS
from dimersweep.kernel.layout import BETA, CA, CB, N1, N2, N_CODES, N_OUT, N_STATE, SPIN, WB
from dimersweep.parameters import Parameters

ROOT = Path(__file__).resolve().parents[1]
START = (
    "from dimersweep import simulate; import time; begun = time.perf_counter(); "
    "simulate(periods=1, record=False); print(time.perf_counter() - begun)"
)


@njit
def single_impacts(row, start, V, tol, n, work, log):
    """n single impacts of p1 from one state."""
    dm = body.as_dimer(row)
    state, total = start.copy(), 0.0
    for _ in range(n):
        state[:] = start
        impact.single_impact(dm, state, -1.0, V, tol, work, log)
        total += state[N1]
    return total


@njit
def double_impacts(row, start, V, tol, n, work, log):
    """n double impacts from one state."""
    dm = body.as_dimer(row)
    state, modes, total = start.copy(), np.zeros(2), 0.0
    for _ in range(n):
        state[:] = start
        impact.double_impact(dm, state, V, tol, modes, work, log)
        total += state[N1]
    return total


@njit
def landings(row, start, n):
    """n searches for the landing that follows one state."""
    dm = body.as_dimer(row)
    total = 0.0
    for _ in range(n):
        _, t, _ = roots.next_landing(flight.take_off(dm, start), dm.T)
        total += t
    return total


@njit
def contact_evaluations(row, y, modes, n):
    """n evaluations of the rates of a rolling contact."""
    dm = body.as_dimer(row)
    dy, F, total = np.zeros(charts.N_Y), np.zeros(6), 0.0
    for k in range(n):
        contact.contact_rates(dm, modes, TWO_PI * k / n, y, False, dy, F)
        total += F[0]
    return total


def best(call, n, repeats):
    """Shortest time of one of the n turns of call(n) [us]."""
    call(1)
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        call(n)
        times.append(time.perf_counter() - begun)
    return 1e6 * min(times) / n


def verbs(repeats):
    """Names and times of the verbs [us], each from a state that the drift of the base case passes."""
    row = Parameters().row()
    work, log = np.zeros((WORK_ROWS, WORK_COLUMNS)), np.zeros((0, impact.N_LOG))
    single = np.zeros(N_STATE)
    single[[BETA, N1, N2, CA, CB, SPIN]] = 0.1, -0.01, -0.01, 0.01, 0.7, 100.0
    double = np.zeros(N_STATE)
    double[[N2, WB, CB, CA, SPIN]] = -0.3, -6.0, 0.7, 0.02, 140.0
    hop = np.zeros(N_STATE)
    hop[[BETA, N1, N2, SPIN]] = 0.1, 0.01, 0.01, 100.0
    hop[2] = 0.05 * np.sin(0.1)
    y, modes = np.zeros(charts.N_Y), np.array([1.0, 0.0])
    y[:4] = 0.1, 1.0, 0.5, 100.0
    out = {"contact rates": best(lambda n: contact_evaluations(row, y, modes, n), 20000, repeats)}
    out["landing of a hop"] = best(lambda n: landings(row, hop, n), 5000, repeats)
    for tol in (1e-6, 1e-8, 1e-10):
        name = f"tol {tol:.0e}"
        out[f"single impact, {name}"] = best(
            lambda n, tol=tol: single_impacts(row, single, 0.01, tol, n, work, log), 5000, repeats
        )
        out[f"double impact, {name}"] = best(
            lambda n, tol=tol: double_impacts(row, double, 0.3, tol, n, work, log), 500, repeats
        )
    return out


def drift_speed(rtol, periods, repeats):
    """Median number of forcing periods a second."""
    row = Parameters().row()[None]
    out, codes = np.zeros((1, N_OUT)), np.zeros((1, N_CODES), np.int64)
    rates = []
    for _ in range(repeats):
        begun = time.perf_counter()
        run_many(row, periods, rtol, False, out, codes)
        rates.append(periods / (time.perf_counter() - begun))
    return float(np.median(rates))


def start_times():
    """Seconds to the end of a first run in a new process, without and with the compiled code in the cache; whole process."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder, "PYTHONPATH": str(ROOT)}
        for _ in range(2):
            begun = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-c", START], env=environment, capture_output=True, text=True, check=True
            )
            rows.append((float(done.stdout), time.perf_counter() - begun))
    return rows


def fig07_time(workers):
    """Seconds of the sweep of Fig. 7 as it is declared, and its number of points."""
    plan = declaration.read_declaration(ROOT / "sweeps" / "fig07.toml")
    settings = plan.sweep
    begun = time.perf_counter()
    cube = sweep(
        plan.grid,
        plan.fixed,
        periods=settings.periods,
        rtol=settings.rtol,
        workers=workers,
        progress=False,
    )
    return time.perf_counter() - begun, cube["mode"].size


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7, help="timings of each thing")
    parser.add_argument("--periods", type=int, default=2000, help="length of the drift")
    parser.add_argument("--workers", type=int, default=2, help="threads of the sweep")
    parser.add_argument("--skip-compile", action="store_true", help="leave out the compile time")
    parser.add_argument("--skip-sweep", action="store_true", help="leave out the sweep")
    options = parser.parse_args()
    simulate(periods=1, record=False)
    print("rtol    forcing periods/s of the base drift")
    for rtol in 10.0 ** -np.arange(5.0, 13.0):
        print(f"{rtol:.0e}   {drift_speed(rtol, options.periods, options.repeats):8.0f}")
    print("\nverb                            us")
    for name, value in verbs(options.repeats).items():
        print(f"{name:28s} {value:6.2f}")
    if not options.skip_compile:
        (cold, cold_all), (warm, warm_all) = start_times()
        print(f"\nfirst run, nothing cached  {cold:6.2f} s ({cold_all:.2f} s with the imports)")
        print(f"first run, from the cache  {warm:6.2f} s ({warm_all:.2f} s with the imports)")
    if not options.skip_sweep:
        taken, points = fig07_time(options.workers)
        print(f"\nsweeps/fig07.toml: {points} points in {taken:.1f} s on {options.workers} workers")


if __name__ == "__main__":
    main()

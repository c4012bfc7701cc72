"""How stored runs end chatter: ``python benchmarks/evidence/general_scenes.py --reference states_general.json``.

It takes runs of unlike ends, other contacts and other plates from the file, which another program has stored, and computes
them with the slow oracle, which takes an end for resting once it leaves the plate slower than `v_rest`. A line for each run:
the largest differences, in the scales of the state,

- of the oracle at ``--v-rest`` to the engine, which follows a chatter to its end: it falls linearly with `v_rest`;
- of the stored run to the oracle at 1e-7 m/s that drops the gap rate of an end at rest, with no impulse for it;
- of the stored run to the engine.

``--eta`` computes all of it with another exponent of the contacts.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from tests.checks.scenes import difference, engine_states
from tests.oracle.dropping import Dropping
from tests.oracle.simulate import Run

DROPPED = 1e-7  # m/s


def states(kind, params, times, rtol, v_rest):
    """States of a run of the oracle."""
    run = kind(params, times, rtol, v_rest)
    status = run.run(max(times))
    if status != "done":
        raise RuntimeError(status)
    return np.array(run.samples)[:, 1:]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--reference", type=Path, required=True, help="file of stored runs")
    parser.add_argument("--cases", type=int, nargs="*", help="numbers of the runs, all if left out")
    parser.add_argument("--v-rest", type=float, nargs="*", default=[1e-7, 1e-8], help="separation speeds [m/s]")
    parser.add_argument("--rtol", type=float, default=1e-10, help="accuracy of the oracle and of the engine")
    parser.add_argument("--samples", type=int, default=8, help="number of samples compared, from the first")
    parser.add_argument("--eta", type=float, help="exponent of the contacts in place of that of the runs")
    options = parser.parse_args()
    heads = [f"to engine at {v_rest:.0e}" for v_rest in options.v_rest]
    print("case  " + "  ".join(heads) + "  stored-dropping  stored-engine    s")
    for case in json.loads(options.reference.read_text())["cases"]:
        if options.cases and case["case"] not in options.cases:
            continue
        stored = np.array(case["samples"])[: options.samples]
        params = case["params"] | ({} if options.eta is None else {"eta": options.eta})
        times, begun = stored[:, 0], time.perf_counter()
        engine, _ = engine_states(params, times, options.rtol)
        slow = [states(Run, params, times, options.rtol, v_rest) for v_rest in options.v_rest]
        dropping = states(Dropping, params, times, options.rtol, DROPPED)
        numbers = [f"{difference(found, engine):18.1e}" for found in slow]
        numbers += [f"{difference(stored[:, 1:], dropping):15.1e}", f"{difference(stored[:, 1:], engine):13.1e}"]
        print(f"{case['case']:4d}  {'  '.join(numbers)}  {time.perf_counter() - begun:3.0f}", flush=True)


if __name__ == "__main__":
    main()

"""Whether the proof that each process begins with sees a product that is rounded where it must not be: ``fusings.py``.

Each place of the kernel's sources at which a sum of products is rounded once (``kernel/compiler/fusing.py``) is changed on its
own: there the product is rounded, and then the sum. The known scenes and arguments of ``work/proving.py`` must come out
otherwise. Where they do not, the change must change no bit of ``--runs`` random runs of the whole model, batch after batch.
The first run that it changes is told: ``--choose`` makes it a known scene, and writes all that the proof is to know.

One kernel is compiled in which a number in memory says which place is changed, so that this takes minutes and not hours.
``--search N`` looks for arguments of the elementary functions that see more, among N million, and makes those known.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp()  # what is compiled here is of no use to anybody else
os.environ["DIMERSWEEP_COMPILER"] = "fast"

import ast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable

from dimersweep.kernel.compiler import fusing

NOWHERE = -1
CHOSEN = np.full(1, NOWHERE)  # the place that is changed
PLACES: list[str] = []
SEED = 55
SHORT = 30  # periods of a random run
MOST_EVENTS = 300  # of a random run: longer ones, a few in a hundred, would take most of the time
BATCH = 500  # random runs
UNITS = 1 << 24  # of one, in which arguments are drawn


def switched(place: int, a: Any, b: Any, c: Any) -> Any:
    """Stand for `fma` in a kernel whose place number `place` may be changed."""


@type_callable(switched)
def _type(_: Any) -> Any:
    return lambda place, a, b, c: types.float64(types.int64, types.float64, types.float64, types.float64)


@lower_builtin(switched, types.int64, types.float64, types.float64, types.float64)
def _code(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    place, a, b, c = given
    address = ir.Constant(ir.IntType(64), CHOSEN.ctypes.data).inttoptr(ir.IntType(64).as_pointer())
    here = builder.icmp_signed("==", builder.load(address), place)
    return builder.select(here, builder.fadd(builder.fmul(a, b), c), builder.fma(a, b, c))


class Switching(fusing.Fusing):
    """Numbers the places."""

    def fused(self, *terms: ast.expr) -> ast.expr:
        """See `Fusing`."""
        call = super().fused(ast.Constant(len(PLACES)), *terms)
        PLACES.append("fma({}, {}, {})".format(*map(ast.unparse, terms)).replace(fusing.NAME, "fma"))
        return call


fusing.Fusing, fusing.fma = Switching, switched
written = fusing.fused


def _noted(function: Any, lines: Any) -> Any:
    first = len(PLACES)
    done = written(function, lines)
    PLACES[first:] = [
        f"{function.__module__.removeprefix('dimersweep.kernel.')}.{function.__name__}: {each}"
        for each in PLACES[first:]
    ]
    return done


from dimersweep.kernel.compiler import jit  # noqa: E402

jit.fused = _noted

from dimersweep.cubes.cube import blank  # noqa: E402
from dimersweep.kernel.batch import run_many  # noqa: E402
from dimersweep.kernel.model.layout import CODE_N_EVENTS  # noqa: E402
from dimersweep.kernel.numerics.elementary import functions  # noqa: E402
from dimersweep.parameters import Parameters  # noqa: E402
from dimersweep.work import proving  # noqa: E402
from tests.checks.random_scenes import parameters_of, rows_of  # noqa: E402

KNOWN = Path(proving.__file__).with_name("known.json")


def results(rows: np.ndarray, periods: int, place: int = NOWHERE) -> np.ndarray:
    """Return the bits that runs come to with a place changed, a row of whole numbers for each."""
    CHOSEN[0] = place
    out, codes = blank(len(rows))
    run_many(rows, periods, proving.PROOF_RTOL, True, out, codes)
    CHOSEN[0] = NOWHERE
    return np.hstack([out.view(np.int64), codes])


def values(arguments: np.ndarray, place: int = NOWHERE) -> np.ndarray:
    """Return the bits of the elementary functions with a place changed, a row of whole numbers for each argument."""
    CHOSEN[0] = place
    found = functions(arguments).view(np.int64)
    CHOSEN[0] = NOWHERE
    return found


def differ(of: Any, given: np.ndarray, place: int, *settings: int) -> np.ndarray:
    """Return which of the `results` or `values` of what is given are changed by a place."""
    return (of(given, *settings, place) != of(given, *settings)).any(axis=1)


def drawn() -> Iterator[np.ndarray]:
    """Yield batches of random runs: a third each near the base case, of the whole model nearby, and of it far away."""
    rng, block = np.random.default_rng(SEED), 0
    while True:
        kinds = ((block, "near"), (block, "whole"), (block + 1, "whole"))
        rows = rng.permutation(np.vstack([rows_of(number, 1000, SEED, kind) for number, kind in kinds]))
        out, codes = blank(len(rows))
        run_many(rows, SHORT, proving.PROOF_RTOL, True, out, codes)
        rows, block = rows[codes[:, CODE_N_EVENTS] < MOST_EVENTS], block + 2
        for first in range(0, len(rows) - BATCH + 1, BATCH):
            yield rows[first : first + BATCH]


def open_places(known: dict[str, Any], places: list[int]) -> list[int]:
    """Return those of some places that neither the known scenes nor the known arguments see."""
    rows = np.array([Parameters(**scene["parameters"]).row() for scene in known["scenes"]])
    seen = (
        differ(results, rows, k, proving.PROOF_PERIODS).any() or differ(values, np.array(known["arguments"]), k).any()
        for k in places
    )
    return [k for k, each in zip(places, seen, strict=True) if not each]


def try_runs(known: dict[str, Any], places: list[int], runs: int, choose: bool) -> list[int]:
    """Tell how random runs answer to a change of each of some places, and return those that change one.

    If it is wanted, one of the runs that do becomes a known scene.
    """
    left, changing, batches = list(places), [], drawn()
    for n in range(0, runs, BATCH):
        rows = next(batches)
        usual = results(rows, SHORT)
        for k in list(left):
            other = np.flatnonzero((results(rows, SHORT, k) != usual).any(axis=1))
            if not other.size:
                continue
            left.remove(k)
            lasting = [
                row for row in rows[other] if choose and differ(results, row[None], k, proving.PROOF_PERIODS).any()
            ]
            if lasting:
                known["scenes"].append({"parameters": parameters_of(lasting[0]), "bits": ""})
                left = open_places({**known, "scenes": known["scenes"][-1:]}, left)
            else:
                changing.append(k)
            print(f"  {PLACES[k]}: changes a run, one of the first {n + BATCH}", flush=True)
    for k in left:
        print(f"  {PLACES[k]}: no bit of {runs} random runs", flush=True)
    return changing


def search(known: dict[str, Any], places: list[int], millions: int) -> None:
    """Add numbers to the known arguments at which elementary functions come out otherwise, as long as there are any."""
    rng, left = np.random.default_rng(SEED), list(places)
    for turn in range(millions):
        some = rng.integers(-9 * UNITS, 9 * UNITS, 1_000_000) // (20 if turn % 2 else 1) / UNITS
        usual = values(some)
        for k in list(left):
            other = np.flatnonzero((values(some, k) != usual).any(axis=1))
            if other.size:
                known["arguments"].append(float(some[other[0]]))
                left.remove(k)
                print(f"  {PLACES[k]}: seen at {some[other[0]]}", flush=True)


def write(known: dict[str, Any]) -> None:
    """Write down what the proof is to know, with the bits that come out now."""
    rows = np.array([Parameters(**scene["parameters"]).row() for scene in known["scenes"]])
    out, codes = blank(len(rows))
    run_many(rows, proving.PROOF_PERIODS, proving.PROOF_RTOL, True, out, codes)
    for scene, *found in zip(known["scenes"], out, codes, strict=True):
        scene["bits"] = proving.bits_of(*found)
    known["functions"] = proving.bits_of(functions(known["arguments"]))
    parts = [",\n    ".join(map(json.dumps, known[name])) for name in ("scenes", "arguments")]
    KNOWN.write_text(
        '{{\n  "scenes": [\n    {}\n  ],\n  "arguments": [\n    {}\n  ],\n  "functions": {}\n}}\n'.format(
            *parts, json.dumps(known["functions"])
        )
    )


def main() -> None:
    """Change each place, and tell which of them nothing sees."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--choose", action="store_true", help="make runs that a change changes known scenes")
    parser.add_argument("--search", type=int, default=0, metavar="MILLIONS")
    parser.add_argument("--bits", action="store_true", help="write the bits of what is known anew, of these sources")
    given = parser.parse_args()
    known = json.loads(KNOWN.read_text())
    results(Parameters().row()[None], 1)  # which compiles
    functions(np.ones(1))
    places = list(range(len(PLACES)))
    elementary = [k for k in places if PLACES[k].startswith(("numerics.elementary", "numerics.sincos"))]
    if given.search:
        search(known, open_places(known, elementary), given.search)
    left = open_places(known, places)
    print(
        f"{len(places)} places, {len(places) - len(left)} of them seen by the proof; of a change at the others:",
        flush=True,
    )
    changing = [] if given.bits else try_runs(known, left, given.runs, given.choose)
    if given.bits or given.choose or given.search:
        write(known)
        print(f"{len(places) - len(open_places(known, places))} of {len(places)} are seen by what is written down")
    sys.exit(bool(changing))


if __name__ == "__main__":
    main()

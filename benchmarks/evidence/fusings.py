"""Whether the proof that each process begins with sees a product that is rounded where it must not be: ``fusings.py``.

Each place of the kernel's sources at which a sum of products is rounded once (``kernel/compiler/fusing.py``) is changed on its
own: there the product is rounded, and then the sum. The known scenes of ``work/proving.py`` must come out otherwise. Where
they do not, ``--runs`` random runs of the whole model are made with the change, and how many of them differ is told.

One kernel is compiled in which a number in memory says which place is changed, so that this takes minutes and not hours.
``--choose N`` looks for a set of scenes, out of N random ones, that together see all that any of them sees, at least time.
"""

import argparse
import os
import sys
import tempfile
from contextlib import suppress
from time import perf_counter
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
MOST_TIME = 0.004  # of a scene that may be chosen [s]


def switched(place: int, a: Any, b: Any, c: Any) -> Any:
    """Stand for `fma` in a kernel whose place number `place` may be changed."""


@type_callable(switched)
def _type(_: Any) -> Any:
    def kind(place: Any, a: Any, b: Any, c: Any) -> Any:
        number = types.int64 if all(isinstance(each, types.Integer) for each in (a, b, c)) else types.float64
        return number(types.int64, number, number, number)

    return kind


@lower_builtin(switched, types.int64, types.float64, types.float64, types.float64)
def _of_floats(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    place, a, b, c = given
    address = ir.Constant(ir.IntType(64), CHOSEN.ctypes.data).inttoptr(ir.IntType(64).as_pointer())
    here = builder.icmp_signed("==", builder.load(address), place)
    return builder.select(here, builder.fadd(builder.fmul(a, b), c), builder.fma(a, b, c))


@lower_builtin(switched, types.int64, types.int64, types.int64, types.int64)
def _of_whole_numbers(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    return builder.add(builder.mul(given[1], given[2]), given[3])


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
from dimersweep.errors import ParameterError  # noqa: E402
from dimersweep.kernel.batch import run_many  # noqa: E402
from dimersweep.kernel.model.layout import CODE_MODE, MODES  # noqa: E402
from dimersweep.kernel.numerics.elementary import functions  # noqa: E402
from dimersweep.parameters import Parameters  # noqa: E402
from dimersweep.work.proving import ARGUMENTS, PROOF_PERIODS, PROOF_RTOL, SCENES, UNITS, bits_of, outcomes  # noqa: E402
from tests.checks.random_scenes import rows_of  # noqa: E402


def bits(rows: np.ndarray, periods: int, place: int = NOWHERE) -> np.ndarray:
    """Return the outcomes of runs with a place changed, a row of bytes for each."""
    CHOSEN[0] = place
    out, codes = blank(len(rows))
    run_many(rows, periods, PROOF_RTOL, True, out, codes)
    CHOSEN[0] = NOWHERE
    return np.hstack([out, codes.astype(float)]).view(np.uint64)


def drawn(n: int) -> np.ndarray:
    """Return rows of random scenes: a third each near the base case, of the whole model nearby, and of it far away."""
    each = -(-n // 3)
    blocks = range(0, 2 * (-(-each // 1000)), 2)
    kinds = [("near", 0), ("whole", 0), ("whole", 1)]
    parts = [np.vstack([rows_of(block + odd, 1000, SEED, kind) for block in blocks])[:each] for kind, odd in kinds]
    return np.vstack(parts)[:n]


def plain_scenes(n: int) -> list[dict[str, float]]:
    """Return random scenes that differ from the base case in few parameters, of two digits."""
    rng = np.random.default_rng(SEED)
    ranges = {
        "e": (0.1, 1.0),
        "Gamma": (0.5, 3.0),
        "f": (10.0, 60.0),
        "A_r": (2.0, 8.0),
        "mu": (0.0, 0.8),
        "beta0": (0.0, 1.3),
        "xdot0": (0.0, 3.0),
        "eta": (1.0, 2.0),
        "tilt": (0.0, 0.3),
        "Gamma_2": (0.0, 2.0),
        "Gamma_x": (0.0, 0.5),
        "gammadot0": (-50.0, 50.0),
        "thetadot0": (-9.0, 9.0),
        "betadot0": (-9.0, 9.0),
        "ydot0": (-1.0, 1.0),
        "r_2": (0.003, 0.008),
        "e_2": (0.0, 1.0),
        "mu_2": (0.0, 0.8),
        "mu_s": (0.2, 1.0),
        "k_ratio": (0.5, 2.0),
    }
    made: list[dict[str, float]] = []
    while len(made) < n:
        names = rng.choice(list(ranges), rng.integers(2, 8), replace=False)
        scene = {str(name): float(f"{rng.uniform(*ranges[name]):.2g}") for name in names}
        with suppress(ParameterError):
            Parameters(**scene)
            made.append(scene)
    return made


def seen(rows: np.ndarray, periods: int, places: list[int]) -> np.ndarray:
    """Return which rows come out otherwise with each place changed, shape (places, rows)."""
    usual = bits(rows, periods)
    return np.array([(bits(rows, periods, place) != usual).any(axis=1) for place in places])


def choose(n: int, places: list[int]) -> None:
    """Print a set of scenes that together see all that any of `n` sees."""
    scenes = plain_scenes(n)
    rows = np.array([Parameters(**scene).row() for scene in scenes])
    cheap = []
    for k, row in enumerate(rows):
        begun = perf_counter()
        bits(row[None], PROOF_PERIODS)
        if perf_counter() - begun < MOST_TIME:
            cheap.append(k)
    table = seen(rows[cheap], PROOF_PERIODS, places)
    left = table.any(axis=1)
    print(f"{left.sum()} of {len(places)} places are seen by {len(cheap)} scenes of at most {MOST_TIME} s", flush=True)
    for k in np.flatnonzero(~left):
        print("  unseen:", PLACES[places[k]])
    while left.any():
        gain = table[left].sum(axis=0)
        k = int(np.argmax(gain))
        left &= ~table[:, k]
        print(f"{gain[k]} more: {scenes[cheap[k]]}", flush=True)


def search(n: int, places: list[int]) -> None:
    """Print numbers at which elementary functions come out otherwise, out of `n` million random ones."""
    rng, left, length = np.random.default_rng(SEED), list(places), 1_000_000
    for turn in range(n):
        if not left:
            break
        k = rng.integers(-9 * UNITS, 9 * UNITS, length) // (20 if turn % 2 else 1)
        usual = functions(k / UNITS).view(np.uint64)
        for place in list(left):
            CHOSEN[0] = place
            changed = np.flatnonzero((functions(k / UNITS).view(np.uint64) != usual).any(axis=1))
            CHOSEN[0] = NOWHERE
            if changed.size:
                print(f"{k[changed[0]]},  # {changed.size} of {turn + 1} million: {PLACES[place]}", flush=True)
                left.remove(place)
    for place in left:
        print("  none:", PLACES[place])


def main() -> None:
    """Change each place, and tell which of them nothing sees."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--choose", type=int, default=0, metavar="N")
    parser.add_argument(
        "--bits", action="store_true", help="print the bits that the proof is to know, of these sources"
    )
    parser.add_argument("--search", type=int, default=0, metavar="MILLIONS")
    given = parser.parse_args()
    rows = np.array([Parameters(**scene.parameters).row() for scene in SCENES])
    bits(rows, 1)  # which compiles
    functions(np.ones(1))
    places = list(range(len(PLACES)))
    elementary = [
        k for k in places if PLACES[k].startswith("numerics.elementary") or PLACES[k].startswith("numerics.sincos")
    ]
    if given.choose or given.search:
        choose(given.choose, [k for k in places if k not in elementary])
        search(given.search, elementary)
        return
    if given.bits:
        for scene, *found in zip(SCENES, *outcomes(), strict=True):
            print(
                f"    Scene({scene.parameters}, {MODES[found[1][CODE_MODE]]!r}, {bits_of(*found)!r}),".replace("'", '"')
            )
        print(f'FUNCTION_BITS = "{bits_of(functions(np.array(ARGUMENTS) / UNITS))}"')
        return
    usual = functions(np.array(ARGUMENTS) / UNITS)
    known = seen(rows, PROOF_PERIODS, places).any(axis=1)
    for place in elementary:
        CHOSEN[0] = place
        known[place] |= bits_of(functions(np.array(ARGUMENTS) / UNITS)) != bits_of(usual)
        CHOSEN[0] = NOWHERE
    print(f"{len(places)} places, {known.sum()} of them seen by the proof", flush=True)
    others, failed = [k for k in places if not known[k]], 0
    many = drawn(given.runs)
    for k in others:
        changed = int(seen(many, SHORT, [k]).sum())
        failed += changed > 0
        print(f"  {PLACES[k]}: {changed} of {given.runs} random runs differ", flush=True)
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()

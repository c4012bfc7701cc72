"""Runs of all lengths and accuracies, over the whole domain and near the base case, whose bits are compared."""

from typing import Any

import numpy as np

from dimersweep.symbols import BASE as BASE_CASE
from tests.checks.random_scenes import parameters_of, rows_of

RUNS = 720
SEED = 11
FAR, NEAR, BASE = range(3)
PERIODS = {FAR: (1, 15), NEAR: (2, 40), BASE: (10, 130)}
LONG = 260  # periods of every fifth run near the base case: enough for a twin of it to be followed
STATES = 40  # times at which the states of a recorded run are compared


def around_base(rng: np.random.Generator, n: int) -> list[dict[str, float]]:
    """Parameters of scenes close to the paper's base case."""
    free = {"e": 0.3, "f": 0.3, "A_r": 0.3, "mu": 0.5, "beta0": 0.8, "xdot0": 0.5}
    made = []
    for _ in range(n):
        scene = {name: BASE_CASE[name] * (1 + width * rng.uniform(-1, 1)) for name, width in free.items()}
        rest = {"mu_s": scene["mu"] * rng.choice([1.0, 2.0]), "Gamma": rng.uniform(0.5, 2.0)}
        made.append(scene | rest)
    return made


def questions(n: int) -> list[dict[str, Any]]:
    """Return what each run is asked for: arguments of `simulate`, and the times of its states as shares of its length."""
    rng = np.random.default_rng(SEED)
    each = -(-n // 3)
    kinds = [
        [parameters_of(row) for row in rows_of(block, each, SEED, ("far", "near")[block])] for block in (FAR, NEAR)
    ]
    kinds.append(around_base(rng, each))
    asked = []
    for k in range(n):
        kind, nth = k % 3, k // 3
        long = kind == BASE and nth % 5 == 0
        stability = kind == BASE and nth % 5 == 1
        periods = LONG if long else int(rng.integers(*PERIODS[kind]))
        settings = {
            "periods": periods,
            "rtol": float(f"{10 ** rng.uniform(-11, -4 if kind == BASE else -3):.3g}"),  # powers are the system's
            "stop_when_settled": stability or bool(rng.random() < 0.5),
            "record": stability or (not long and bool(rng.random() < 0.6)),
        }
        shares = np.sort(rng.random(STATES)).tolist() if settings["record"] else []
        asked.append({"scene": kinds[kind][nth] | settings, "shares": shares, "stability": stability})
    return asked

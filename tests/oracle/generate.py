"""Write the project's own small reference: ``python -m tests.oracle.generate`` (deterministic, some minutes)."""

import json
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from . import body
from .impact import apply
from .simulate import SCALE, simulate

TARGET = Path(__file__).resolve().parents[1] / "reference" / "small.json"
SEED = 20240229

BASE = {"e": 0.6, "Gamma": 0.9, "f": 15.0, "A_r": 6.0, "mu": 0.2, "mu_s": 0.4, "beta0": 4 * pi / 45, "xdot0": 1.0}
RUNS: dict[str, dict[str, float]] = {
    "base": {},
    "low friction": {"mu": 0.05, "mu_s": 0.1},
    "dead": {"e": 0.45, "Gamma": 0.5, "A_r": 5.3, "beta0": 0.06, "mu": 0.25},
    "strong shaking": {"Gamma": 1.3, "e": 0.5, "A_r": 4.4, "beta0": 0.2},
    "unequal restitution, short, rough": {"e_1": 0.7, "e_2": 0.5, "A_r": 4.2, "mu": 0.5, "mu_s": 0.7, "beta0": 0.24},
    "planar": {"xdot0": 0.0, "A_r": 6.5},
    "plate phase": {"phi0": 1.2, "f": 20.0, "beta0": 0.15, "A_r": 5.6},
    "other body": {"r": 4e-3, "rho_b": 2500.0, "rho_r": 2700.0, "D_r": 3e-3, "A_r": 5.0, "xdot0": 0.7},
    "one coefficient": {"mu": 0.3, "mu_s": 0.3, "beta0": 0.12},
    "smooth": {"mu": 0.0, "mu_s": 0.0, "e": 0.8, "beta0": 0.35},
    "long": {"A_r": 7.0, "f": 25.0, "beta0": 0.1005},
    "no restitution": {"e": 0.0, "beta0": 0.2, "A_r": 5.2, "xdot0": 0.4},
}


def run_case(name: str, change: dict[str, float]) -> dict[str, Any]:
    """One run at two accuracies: the finer one's result, and their difference."""
    params = {**BASE, **change}
    times = [float(t) for t in np.linspace(1 / 3, 2, 6) / params["f"]]
    coarse = simulate(params, times, rtol=1e-9, v_rest=1e-9)
    fine = simulate(params, times, rtol=1e-10, v_rest=1e-10)
    assert fine["status"] == coarse["status"] == "done"
    spread = float((np.abs(fine["samples"] - coarse["samples"])[:, 1:] / SCALE).max())
    print(f"{name}: {len(fine['events'])} events, spread {spread:.1e}")
    return {
        "name": name,
        "params": params,
        "samples": fine["samples"].tolist(),
        "t_double": fine["t_double"][:6],
        "spread": spread,
    }


def impact_case(rng: np.random.Generator, k: int) -> dict[str, Any]:
    """One isolated impact with random parameters and velocities at the scale of real ones."""
    double = k % 2 == 0
    closed = [True, True] if double else [k % 4 == 1, k % 4 == 3]
    mu = float(rng.uniform(0.05, 0.5))
    params = {
        "e_1": float(rng.uniform(0.2, 0.95)),
        "A_r": float(rng.uniform(3, 8)),
        "mu": mu,
        "mu_s": mu * float(rng.choice([1.0, 1.3, 2.0])),
    }
    params["e_2"] = float(rng.uniform(0.2, 0.95)) if k % 3 == 0 else params["e_1"]
    if k % 20 == 17:
        params.update(e_1=0.0, e_2=0.0)
    if k % 20 == 12:
        params.update(e_1=1.0, e_2=1.0, mu=0.0, mu_s=0.0)
    d = body.dimer(params)
    q = np.array([0, 0, 0, rng.uniform(-pi, pi), 0.0 if double else rng.uniform(-0.6, 0.6), rng.uniform(-pi, pi)])
    qdot = rng.normal(size=6) * [0.5, 0.5, 0.1, 1.0, 4.0, 80.0]
    kind = "random"
    if double and k % 8 < 4:  # as in the drift mode: end 1 rests on the plate, end 2 lands
        kind, qdot[2], qdot[4] = "landing", 0.0, -abs(qdot[4])
        if k % 8 == 2:  # and end 1 rolls
            kind = "landing, end 1 rolls"
            qdot[:2] -= body.slips(d, q, qdot)[0]
    rates = body.gap_rates(d, q, qdot)
    if all(rates[i] >= 0 for i in (0, 1) if closed[i]):
        qdot[[2, 4]] *= -1
    after, details = apply(d, q, qdot, closed, tol=1e-12)
    return {
        "kind": kind,
        "params": params,
        "q": q.tolist(),
        "closed": closed,
        "qdot_minus": qdot.tolist(),
        "qdot_plus": after.tolist(),
        "end": list(details["end"]),
        "log": details["log"],
    }


def main() -> None:
    """Compute everything and write the file."""
    rng = np.random.default_rng(SEED)
    out = {
        "about": "Runs of the dimer over two forcing periods, and isolated impacts, from tests/oracle; "
        "default constants where not named (r=5e-3, rho_b=7850, rho_r=1180, D_r=4e-3, g=9.81, phi0=0).",
        "units": "SI, rad",
        "state": "x1 y1 delta1 theta beta gamma and their rates; delta1 = z1 - r - z_p(t), rate relative to the plate",
        "start": "end 1 on the plate (delta1 = 0) and at rest in space but for xdot0: delta1' = -A_z omega cos(phi0)",
        "samples": "rows: t, then the 12 state entries",
        "t_double": "times of the first impacts that began with both contacts closed (at most six)",
        "scale": SCALE.tolist(),
        "accuracy": "spread: largest difference over `scale` between rtol = v_rest = 1e-9 and 1e-10 (stored: 1e-10)",
        "impacts": "q and its rates before and after, coordinates of `state`; with e = 0 the restitution of an end "
        "ends at once where its compression does; end: sk, sp, or - where not closed",
        "seed": SEED,
        "cases": [run_case(name, change) for name, change in RUNS.items()],
        "impact_cases": [impact_case(rng, k) for k in range(40)],
    }
    TARGET.parent.mkdir(exist_ok=True)
    TARGET.write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()

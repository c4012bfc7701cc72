"""Random scenes over the whole domain of the model, by their numbers; runs of them, and what is wrong with one."""

import time
from math import pi

import numpy as np

from dimersweep.kernel.batch import run_many, work_done
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import M_DRIFT, N_CODES, N_OUT, OK, OUT, ROW, STATUSES
from dimersweep.parameters import Parameters, fill_rows
from dimersweep.symbols import BASE, LEFT_OUT
from tests.checks.examine import CODE, examine, lies

BLOCK = 1000  # scenes that have random numbers of their own


def pick(rng, n, usual, *special, share=0.05):
    """`usual` values, each replaced by one of the special ones (numbers, or columns) with probability `share` each."""
    which = rng.random(n)
    values = usual.copy()
    for k, value in enumerate(special):
        values = np.where((which >= k * share) & (which < (k + 1) * share), value, values)
    return values


def log_uniform(rng, low, high, n):
    """Values whose logarithm is uniform."""
    return np.exp(rng.uniform(np.log(low), np.log(high), n))


def far(rng, n):
    """Scenes over the whole domain: decades evenly where a range spans them, and its corners and edges on purpose."""
    tiny = log_uniform(rng, 1e-12, 1e-2, n)
    mu = pick(rng, n, np.where(rng.random(n) < 0.5, rng.uniform(0, 5, n), log_uniform(rng, 1e-4, 5, n)), 0.0, 5.0)
    r = log_uniform(rng, 1e-5, 1, n)
    Gamma = np.where(rng.random(n) < 0.5, rng.uniform(0, 20, n), log_uniform(rng, 1e-3, 20, n))
    return {
        "e": pick(rng, n, rng.uniform(0, 1, n), 0.0, 1.0, tiny, 1.0 - tiny),
        "Gamma": pick(rng, n, Gamma, 0.0, 1.0, 1.0 + tiny),
        "f": log_uniform(rng, 1, 1000, n),
        "A_r": pick(rng, n, log_uniform(rng, 2, 50, n), 2.0, 2.0 + tiny),
        "mu": mu,
        "mu_s": pick(rng, n, rng.uniform(mu, 5.0), mu, 5.0, mu * (1.0 + tiny)),
        "beta0": pick(rng, n, rng.uniform(0, pi / 2, n), 0.0, tiny, (pi / 2 - tiny) * (1.0 - 1e-15)),
        "xdot0": pick(rng, n, log_uniform(rng, 1e-3, 100, n), 0.0, 100.0, tiny),
        "phi0": pick(rng, n, rng.uniform(0, 2 * pi, n), 0.0, pi / 2),
        "r": r,
        "rho_b": log_uniform(rng, 10, 1e5, n),
        "rho_r": log_uniform(rng, 10, 1e5, n),
        "D_r": pick(rng, n, 2.0 * r * rng.uniform(0, 1, n), 2.0 * r, 0.0),
        "g": np.full(n, BASE["g"]),
    }


def near(rng, n):
    """Scenes about as far from the base case as a laboratory would go."""
    mu = pick(rng, n, rng.uniform(0, 1, n), 0.0)
    return {
        "e": pick(rng, n, rng.uniform(0.05, 0.98, n), 0.0, 1.0),
        "Gamma": pick(rng, n, rng.uniform(0, 3, n), 0.0, 1.0),
        "f": log_uniform(rng, 5, 100, n),
        "A_r": pick(rng, n, rng.uniform(2, 10, n), 2.0),
        "mu": mu,
        "mu_s": pick(rng, n, mu * rng.uniform(1, 2, n), mu),
        "beta0": pick(rng, n, rng.uniform(0, 1.5, n), 0.0),
        "xdot0": pick(rng, n, rng.uniform(0, 3, n), 0.0),
        "phi0": pick(rng, n, rng.uniform(0, 2 * pi, n), 0.0),
        "r": np.full(n, BASE["r"]),
        "rho_b": np.full(n, BASE["rho_b"]),
        "rho_r": np.full(n, BASE["rho_r"]),
        "D_r": np.full(n, BASE["D_r"]),
        "g": np.full(n, BASE["g"]),
    }


def wild(rng, n):
    """Scenes beyond all that is ever built: every range as wide as it goes, in scales as well as in shape and in time."""
    mu = rng.uniform(0, 5, n)
    return far(rng, n) | {
        "Gamma": log_uniform(rng, 1e-3, 50, n),
        "f": log_uniform(rng, 1e-2, 1e4, n),
        "A_r": log_uniform(rng, 2, 200, n),
        "mu": mu,
        "mu_s": rng.uniform(mu, 5.0),
        "xdot0": rng.choice([-1.0, 1.0], n) * log_uniform(rng, 1e-3, 1e3, n),
        "D_r": np.zeros(n),
        "g": log_uniform(rng, 1e-3, 1e3, n),
    }


def wider(rng, n, columns):
    """What the parameters that may be left out add to scenes: a second harmonic, and another hold of lasting contacts."""
    Gamma, mu, mu_s = columns["Gamma"], columns["mu"], columns["mu_s"]
    tiny = log_uniform(rng, 1e-12, 1e-2, n)
    Gamma_2 = np.where(rng.random(n) < 0.5, Gamma * rng.uniform(0, 2, n), log_uniform(rng, 1e-3, 20, n))
    return {
        "Gamma_2": pick(rng, n, Gamma_2, 0.0, Gamma, 0.25 * Gamma, tiny),
        "phi_2": pick(rng, n, rng.uniform(0, 2 * pi, n), 0.0, pi / 2, 1.5 * pi),
        "mu_h": pick(rng, n, rng.uniform(mu, 1.5 * mu_s), mu, mu_s, mu * (1.0 + tiny)),
    }


def rows_of(block, n, seed, domain):
    """Parameter rows of the first `n` scenes of one block; each block has random numbers of its own."""
    rng = np.random.default_rng([seed, block])
    away = domain == "far" or (domain in ("mixed", "wider") and block % 2)
    columns = wild(rng, BLOCK) if domain == "wild" else far(rng, BLOCK) if away else near(rng, BLOCK)
    if domain == "wider":
        columns |= wider(rng, BLOCK, columns)
    return fill_rows(columns, BLOCK)[:n]


def scene_row(k, seed, domain):
    """Row of scene number k."""
    return rows_of(k // BLOCK, BLOCK, seed, domain)[k % BLOCK]


def parameters_of(row):
    """Keywords of ``simulate`` of a row of these scenes."""
    values = dict(zip(ROW, row.tolist(), strict=True))
    values["e"] = values.pop("e_1")
    del values["e_2"]
    return {name: value for name, value in values.items() if name not in LEFT_OUT or value != base(values, name)}


def base(scene, name):
    """Value of a parameter of a scene where it is left out; None if the scene has no such value."""
    value = BASE[name] if name in BASE else LEFT_OUT[name]
    return scene.get(value) if isinstance(value, str) else value


def run_block(rows, periods, rtol):
    """Codes, numbers, seconds (of this thread's own time) and work of scenes, one after the other."""
    codes, out = np.zeros((len(rows), N_CODES), np.int64), np.full((len(rows), N_OUT), np.nan)
    seconds, work, space = np.zeros(len(rows)), np.zeros(len(rows)), new_workspace()
    for k in range(len(rows)):
        begun = time.thread_time()
        run_many(rows[k : k + 1], periods, rtol, False, out[k : k + 1], codes[k : k + 1], 0, space)
        seconds[k], work[k] = time.thread_time() - begun, work_done(space)
    return codes, out, seconds, work


def lying_nan(codes, out):
    """Which runs have status ok and a number that should be finite and is not."""
    shares = [OUT.index("down_share_1"), OUT.index("down_share_2")]
    orbit = [k for k, name in enumerate(OUT) if not name.endswith("_drift") and name != "settled_after"]
    drift = codes[:, CODE["mode"]] == M_DRIFT
    ok = codes[:, CODE["status"]] == OK
    return ok & (~np.isfinite(out[:, shares]).all(1) | (drift & ~np.isfinite(out[:, orbit]).all(1)))


def faults(scene, periods, rtol, examined=True):
    """What is wrong with a scene: its status, or what its record shows."""
    row = Parameters(**scene).row()
    codes, _, _, _ = run_block(row[None], periods, rtol)
    status = STATUSES[codes[0, CODE["status"]]]
    seen = examine(row, periods, rtol) if examined and status == "ok" else None
    return [status] * (status != "ok") + (lies(seen) if seen else [])

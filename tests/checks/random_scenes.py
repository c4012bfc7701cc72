"""Random scenes over the whole domain of the model, by their numbers; runs of them, and what is wrong with one."""

import threading
import time
from contextvars import ContextVar
from functools import lru_cache
from math import inf, pi
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.batch import run_many, stop
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import (
    HARMONICS,
    M_DRIFT,
    N_CODES,
    N_OUT,
    NOT_RUN,
    OK,
    OUT,
    ROW,
    STATUSES,
    STOPPED,
    WAVES,
)
from dimersweep.kernel.numerics.elementary import angles
from dimersweep.parameters import Parameters, fill_rows, value_of
from dimersweep.studies.point_tables import between
from dimersweep.symbols import BASE, ENDS, LEFT_OUT
from tests.checks.examine import CODE, examine, lies

BLOCK = 1000  # scenes that have random numbers of their own
SEED = 20240305  # of the scenes that are compared with other programs
SAWS = {"harmonics": 0.5, "sawtooth": 1.0}  # domains of higher harmonics, with the share of saw-tooths
LONGEST = 5.0  # time for a scene [s], after which it is stopped


def pick(rng, n, usual, *special, share=0.05):
    """`usual` values, each replaced by one of the special ones (numbers, or columns) with probability `share` each."""
    which = rng.random(n)
    values = usual.copy()
    for k, value in enumerate(special):
        values = np.where((which >= k * share) & (which < (k + 1) * share), value, values)
    return values


# scenes of the block being made that are the same on every processor: all of them, or the one that is asked for
EXACT = ContextVar("EXACT", default=slice(None))


def log_uniform(rng, low, high, n):
    """Values whose logarithm is uniform; those of `EXACT` scenes are the same ones on every processor, which takes long."""
    share = rng.random(n)
    values = low * (high / low) ** share
    exact = EXACT.get()
    values[exact] = between(low, high, True, share[exact])
    return values


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
    } | {name: np.full(n, BASE[name]) for name in ("r", "rho_b", "rho_r", "D_r", "g")}


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


class Reach(NamedTuple):
    """How far scenes of the whole model go in what the base case lacks: the ends of ranges."""

    unlike: float  # most one end's value is over the other's
    eta: float
    k_ratio: float
    tilt: float  # [rad]
    along: tuple[float, float]  # least and greatest intensity of the motion along the plate, where there is one
    speed: tuple[float, float]  # of ball 1 [m/s]
    rate: tuple[float, float]  # of dip and heading [rad/s]
    spin: tuple[float, float]  # [rad/s]
    gap: tuple[float, float]  # over the radius


LABORATORY = Reach(2.0, 2.0, 4.0, 0.3, (1e-3, 1.0), (1e-2, 3.0), (0.1, 10.0), (1.0, 300.0), (1e-3, 2.0))
BEYOND = Reach(10.0, 4.0, 1e3, pi / 2, (1e-3, 20.0), (1e-3, 100.0), (1e-3, 1e4), (1e-3, 1e5), (1e-9, 100.0))
NONE = 0.5  # share of the scenes without a feature


def signed(rng, n, low, high):
    """Values of either sign whose logarithm is uniform, some of them zero."""
    return pick(rng, n, rng.choice([-1.0, 1.0], n) * log_uniform(rng, low, high, n), 0.0, share=0.2)


def some(rng, n, values, usual=0.0):
    """The values in some of the scenes, and the usual one in the others."""
    return np.where(rng.random(n) < NONE, usual, values)


def unlike_ends(rng, n, columns, reach):
    """Values of each end's own in place of those of both, which may all the same be equal, or nearly so."""
    tiny, apart = log_uniform(rng, 1e-12, 1e-2, n), rng.random(n) < NONE
    ends = {name: value for name, value in columns.items() if name not in ("e", "r", "rho_b", "mu", "mu_s", "mu_h")}
    ratio = {}
    for name in ("r", "rho_b", "mu", "hold"):
        drawn = pick(rng, n, log_uniform(rng, 1.0 / reach.unlike, reach.unlike, n), 1.0 + tiny)
        ratio[name] = np.where(apart & (rng.random(n) < 0.7), drawn, 1.0)
    mu_2 = pick(rng, n, columns["mu"] * ratio["mu"], columns["mu"] * np.where(apart, 0.0, 1.0))
    for name in ("r", "rho_b"):
        ends |= {f"{name}_1": columns[name], f"{name}_2": columns[name] * ratio[name]}
    ends |= {"mu_1": columns["mu"], "mu_2": mu_2}
    for name in ("mu_s", "mu_h"):
        ends |= {f"{name}_1": columns[name], f"{name}_2": np.maximum(mu_2, columns[name] * ratio["mu"] * ratio["hold"])}
    e_2 = pick(rng, n, rng.uniform(0, 1, n), 0.0, 1.0, tiny, 1.0 - tiny)
    ends |= {"e_1": columns["e"], "e_2": np.where(apart & (rng.random(n) < 0.7), e_2, columns["e"])}
    ends["D_r"] = np.minimum(columns["D_r"], 2.0 * np.minimum(ends["r_1"], ends["r_2"]))
    return ends


def contacts(rng, n, columns, reach):
    """Exponent and stiffness of the contacts: Hertz's law, linear springs, others."""
    hertz = np.sqrt(columns["r_2"] / columns["r_1"])
    ratio = pick(rng, n, log_uniform(rng, 1.0 / reach.k_ratio, reach.k_ratio, n), 1.0)
    eta = pick(rng, n, rng.uniform(1.0, reach.eta, n), 1.0, 2.0)
    return {"eta": some(rng, n, eta, 1.5), "k_ratio": some(rng, n, ratio, hertz)}


def plates(rng, n, columns, reach):
    """A plate that is tilted, and one that moves along itself, in step with its motion along the normal or not."""
    tiny = log_uniform(rng, 1e-12, 1e-2, n)
    phi_x = pick(rng, n, rng.uniform(0, 2 * pi, n), 0.0, pi / 2, pi)
    drawn = {
        "tilt": some(rng, n, pick(rng, n, rng.uniform(0, reach.tilt, n), tiny, reach.tilt * (1.0 - tiny))),
        "azimuth": pick(rng, n, rng.uniform(0, 2 * pi, n), 0.0, pi / 2),
        "phi_x": phi_x,
        "phi_y": pick(rng, n, rng.uniform(0, 2 * pi, n), 0.0, phi_x, phi_x + pi / 2),
    }
    for axis in "xy":
        Gamma = pick(rng, n, log_uniform(rng, *reach.along, n), columns["Gamma"], tiny)
        drawn[f"Gamma_{axis}"] = some(rng, n, Gamma)
    return drawn


def starts(rng, n, columns, reach):
    """Starts over the plate or on it, with either end down or both, that turn about every axis."""
    tiny = log_uniform(rng, 1e-12, 1e-2, n)
    r_1, r_2 = columns["r_1"], columns["r_2"]
    rise = (r_2 - r_1) / ((columns["A_r"] - 1.0) * (r_1 + r_2))
    level = angles(rise, np.sqrt((1.0 - rise) * (1.0 + rise)))
    beta0 = rng.choice([-1.0, 1.0], n) * columns["beta0"]
    return {
        "beta0": pick(rng, n, beta0, level, level + tiny, level - tiny, 0.0),
        "xdot0": rng.choice([-1.0, 1.0], n) * columns["xdot0"],
        "theta0": pick(rng, n, rng.uniform(-pi, pi, n), 0.0, pi / 2),
        "ydot0": some(rng, n, signed(rng, n, *reach.speed)),
        "betadot0": some(rng, n, signed(rng, n, *reach.rate)),
        "thetadot0": some(rng, n, signed(rng, n, *reach.rate)),
        "gammadot0": some(rng, n, signed(rng, n, *reach.spin)),
        "gap0": some(rng, n, np.minimum(r_1, r_2) * pick(rng, n, log_uniform(rng, *reach.gap, n), tiny)),
    }


def whole(rng, n, away):
    """Scenes of the whole model: those of `far` or `near` with all that may be left out, each feature in some of them."""
    columns, reach = (far(rng, n), BEYOND) if away else (near(rng, n), LABORATORY)
    added = wider(rng, n, columns)
    columns |= {
        "Gamma_2": some(rng, n, added["Gamma_2"]),
        "phi_2": added["phi_2"],
        "mu_h": some(rng, n, added["mu_h"], columns["mu_s"]),
    }
    columns = unlike_ends(rng, n, columns, reach)
    for kind in (contacts, plates, starts):
        columns |= kind(rng, n, columns, reach)
    return columns


def harmonics(rng, n, columns, saws):
    """Higher harmonics of the plate along its normal, or along all axes: in a share `saws` those of a saw-tooth, else some of
    any phases.
    """
    waves = {}
    for axis, wave in enumerate(WAVES):
        there = rng.random(n) < (1.0 if axis == 0 else 0.3)
        saw, last = rng.random(n) < saws, rng.integers(2, HARMONICS + 1, n)
        first = columns.get(wave[0][0], np.zeros(n))
        phase = columns["phi0"] if axis == 0 else columns.get(wave[0][1], np.zeros(n))
        for k, (Gamma, phi) in enumerate(wave[1:], start=2):
            size = np.where(saw, 1.0, rng.random(n) * (k <= last)) * first / k
            waves[Gamma] = np.where(there, size, 0.0)
            waves[phi] = np.where(saw, k * phase if axis == 0 else (k - 1) * phase, rng.uniform(0, 2 * pi, n))
    return waves


def rows_of(block, n, seed, domain):
    """Parameter rows of the first `n` scenes of one block; each block has random numbers of its own."""
    return block_of(block, seed, domain)[:n].copy()


@lru_cache(maxsize=100)  # a block takes half a second, for the exponentials of its logarithms; one scene far less
def block_of(block, seed, domain, scene=None):
    """Parameter rows of a block, of which only the `scene` of that number need be exact if it is given."""
    EXACT.set(slice(None) if scene is None else slice(scene, scene + 1))
    rng = np.random.default_rng([seed, block])
    away = domain == "far" or (domain in ("mixed", "wider", "whole", *SAWS) and block % 2 == 1)
    if domain == "whole" or domain in SAWS:
        columns = whole(rng, BLOCK, away)
    else:
        columns = wild(rng, BLOCK) if domain == "wild" else far(rng, BLOCK) if away else near(rng, BLOCK)
    if domain == "wider":
        columns |= wider(rng, BLOCK, columns)
    if domain in SAWS:
        columns |= harmonics(rng, BLOCK, columns, SAWS[domain])
    return fill_rows(columns, BLOCK)


def scene_row(k, seed, domain):
    """Row of scene number k."""
    return block_of(k // BLOCK, seed, domain, k % BLOCK)[k % BLOCK].copy()


def laboratory_row(k, seed):
    """Row of scene number k of the whole model as a laboratory might build it."""
    return scene_row(k // BLOCK * 2 * BLOCK + k % BLOCK, seed, "whole")


def whole_scene(k):
    """Parameters of that scene."""
    return parameters_of(laboratory_row(k, SEED))


def parameters_of(row):
    """Keywords of ``simulate`` of a row of these scenes."""
    values = dict(zip(ROW, row.tolist(), strict=True))
    for both, (one, two) in ENDS.items():
        if values[one] == values[two]:
            values[both] = values.pop(one)
            del values[two]
    return {name: value for name, value in values.items() if name not in LEFT_OUT or value != base(values, name)}


def base(scene, name):
    """Value of a parameter of a scene where it is left out."""
    return BASE[name] if name in BASE else value_of(name, BASE | {key: scene[key] for key in scene if key != name})


class Watch:
    """Stops runs on the scratch arrays of this thread that take longer than some seconds of its own time."""

    def __init__(self, space, seconds):
        self.space, self.seconds, self.clock = space, seconds, time.pthread_getcpuclockid(threading.get_ident())
        self.due, self.lock, self.over = inf, threading.Lock(), threading.Event()
        threading.Thread(target=self.look, daemon=True).start()

    def look(self):
        """Stop what is overdue, until the watch is over."""
        while not self.over.wait(0.1):
            with self.lock:
                if time.clock_gettime(self.clock) > self.due:
                    stop(self.space)

    def restart(self):
        """Begin with another run."""
        with self.lock:
            self.space.work.meter[0].stop = False
            self.due = time.clock_gettime(self.clock) + self.seconds


def run_block(rows, periods, rtol, longest=LONGEST):
    """Codes, numbers, seconds (of this thread's own time) and work of scenes, one after the other, each stopped when it
    takes too long.
    """
    codes, out = np.zeros((len(rows), N_CODES), np.int64), np.full((len(rows), N_OUT), np.nan)
    seconds, work, space = np.zeros(len(rows)), np.zeros(len(rows)), new_workspace()
    watch = Watch(space, longest)
    for k in range(len(rows)):
        watch.restart()
        begun = time.thread_time()
        run_many(rows[k : k + 1], periods, rtol, False, out[k : k + 1], codes[k : k + 1], 0, space)
        seconds[k], work[k] = time.thread_time() - begun, space.work.meter[0].spent
    watch.over.set()
    codes[codes[:, CODE["status"]] == NOT_RUN, CODE["status"]] = STOPPED
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

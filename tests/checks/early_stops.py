"""Runs that stop early beside whole ones: every word and every number that differs, over random scenes of the whole model."""

from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.course import new_workspace
from dimersweep.kernel.model.layout import CODES, M_FAILED, OUT, ROW, SPIN
from dimersweep.kernel.verdict.classify import STRAIGHT
from dimersweep.kernel.verdict.settling import SLOW_SPEED
from dimersweep.parameters import fill_rows
from dimersweep.symbols import BASE
from tests.checks.data import data
from tests.checks.random_scenes import BLOCK, rows_of

WITHIN = 1e-3  # how far a number of a stopped run may be from that of the whole one (docs/stopping.md)
WORDS = ("status", "mode", "mode_period", "di_end", "track")
ITS_OWN = ("n_events", "n_periods", "change_ahead")  # what a stopped run has no less rightly than the whole one
NUMBERS = tuple(name for name in OUT if name not in ITS_OWN)
FAMILIES = ("around the paper's", "unlike ends", "level plate", "whole model")
UNLIKE = {"r": (0.8, 1.25), "rho_b": (0.5, 2.0), "mu": (0.7, 1.4), "e": (0.9, 1.1)}  # value of p2 over that of p1
SPEEDS = ("speed", "path_speed", "centre_velocity_x", "centre_velocity_y")
INVERSE = ("radius", "path_radius", "period")  # none where a path is straight: what counts is the bend
ABSOLUTE = ("zeta", "impact_phase", "down_share_1", "down_share_2", "longest_hop_1", "longest_hop_2")
ABSOLUTE += ("settled_after",)


def around_the_papers(n, seed, unlike):
    """Rows of scenes in which many drift, their ends alike or not."""
    rng = np.random.default_rng(seed)
    columns = {name: rng.uniform(*ends, n) for name, ends in data("scenes")["drifting"].items()}
    columns["mu_s"] *= columns["mu"]
    least = columns["r"]
    if unlike:
        columns["mu_h"] = columns["mu_s"] * np.where(rng.random(n) < 0.5, 1.0, rng.uniform(1.0, 1.3, n))
        for name, ends in UNLIKE.items():
            ratio = rng.uniform(*ends, n)
            for both in ("mu", "mu_s", "mu_h") if name == "mu" else (name,):
                one = columns.pop(both)
                columns |= {f"{both}_1": one, f"{both}_2": one * ratio}
        least = np.minimum(columns["r_1"], columns["r_2"])
    columns["D_r"] *= least
    return fill_rows({name: value for name, value in BASE.items() if f"{name}_1" not in columns} | columns, n)


def laboratory(n, seed, level):
    """Rows of scenes of the whole model as a laboratory might build it, their plate level or not."""
    blocks = [rows_of(2 * k, BLOCK, seed, "whole") for k in range(-(-n // BLOCK))]
    rows = np.concatenate(blocks)[:n]
    if level:
        rows[:, [ROW.index(name) for name in ("tilt", "Gamma_x", "Gamma_y")]] = 0.0
    return rows


def scenes(n, seed):
    """Rows of `n` scenes and the family of each, the families in turns."""
    each = -(-n // len(FAMILIES))
    kinds = (
        around_the_papers(each, seed, False),
        around_the_papers(each, seed + 1, True),
        laboratory(each, seed, True),
        laboratory(each, seed + 1, False),
    )
    return np.stack(kinds, axis=1).reshape(-1, len(ROW))[:n], np.arange(n) % len(FAMILIES)


class Both(NamedTuple):
    """Outcomes of stopped and of whole runs by the names of the kernel, for those that stopped early."""

    rows: np.ndarray
    which: np.ndarray  # numbers of the scenes that stopped early
    every: dict  # of all runs that may stop
    stopped: dict  # of those that did
    whole: dict
    left: np.ndarray  # periods that were not made


def outcomes(rows, periods, rtol, settle):
    """Outcomes of runs by the names of the kernel, and the spin at their ends."""
    (out, codes), spin, space = blank(len(rows)), np.zeros(len(rows)), new_workspace()
    for k in range(len(rows)):
        run_many(rows[k : k + 1], periods, rtol, settle, out[k : k + 1], codes[k : k + 1], 0, space)
        spin[k] = space.state[SPIN]
    return dict(zip(OUT, out.T, strict=True)) | dict(zip(CODES, codes.T, strict=True)) | {"end_spin": spin}


def both_ways(rows, periods=300, rtol=1e-8):
    """Runs to where they stop; those that stop early to their last period, too. (Of the others there is but one run.)"""
    stopped = outcomes(rows, periods, rtol, True)
    which = np.flatnonzero((stopped["n_periods"] < periods) & (stopped["mode"] != M_FAILED))
    whole = outcomes(rows[which], periods, rtol, False)
    early = {name: values[which] for name, values in stopped.items()}
    return Both(rows[which], which, stopped, early, whole, periods - early["n_periods"])


def apart(both):
    """How far each outcome of a stopped run is from the whole one's: 0 or 1 of a word, of a number in what WITHIN counts.

    Numbers count where mode and period are the same: else the words tell. A pace counts by what it comes to in the periods
    that were not made; each of the two may be as far from none as a number may change, so it counts half.
    """
    found = {name: (both.stopped[name] != both.whole[name]).astype(float) for name in WORDS}
    same = (found["mode"] == 0) & (found["mode_period"] == 0)
    least = leasts(both.rows)
    for name in NUMBERS:
        number, pace = name.removesuffix("_drift"), name.endswith("_drift")
        ours, whole, size = (
            both.stopped[name],
            both.whole[name],
            np.abs(both.whole["end_spin" if name == "spin_drift" else number]),
        )
        if name in INVERSE:
            ours, whole, size = (np.where(np.isnan(values), 0.0, 1.0 / values) for values in (ours, whole, size))
        change = np.abs(ours - whole) * (0.5 * both.left if pace else 1.0)
        if name == "impact_phase":
            change = np.minimum(change, 1.0 - change)
        if number in ABSOLUTE:
            size = 1.0
        elif number in least and not (pace and number in INVERSE):
            size = np.fmax(size, least[number])
        with np.errstate(invalid="ignore"):
            far = np.where(np.isnan(ours) == np.isnan(whole), np.nan_to_num(change / size), np.inf)
        found[name] = np.where(same, far, 0.0)
    return found


def leasts(rows):
    """The least sizes by which changes count: those of slow dimers and of straight paths."""
    of = dict(zip(ROW, rows.T, strict=True))
    omega = 2.0 * np.pi * of["f"]
    unit = of["g"] / omega
    bend, r = STRAIGHT * omega, np.maximum(of["r_1"], of["r_2"])
    slow = SLOW_SPEED * unit
    least = dict.fromkeys(SPEEDS, slow) | {"precession_rate": bend, "spin": unit / r}
    least |= {"radius": bend / slow, "path_radius": bend / slow, "period": bend / (2.0 * np.pi)}
    return least | {"beta_rate_after": slow / ((of["A_r"] - 1.0) * (of["r_1"] + of["r_2"]))}

"""Siconos beside the engine: ``python benchmarks/peers/siconos/judge.py [--small]``, some minutes (half a minute).

`judge.cpp` has Siconos compute with its law of multiple impacts (LZB), in steps of impulse: impacts of three balls in a row,
impacts of a frictionless dimer at both ends, and short runs of a planar frictionless dimer on the shaking plate. Printed is
how far they are from a direct integration of the law (the balls) and from the engine (the dimer), over exponents `eta` and
ratios of stiffness, and the processor time of both at equal error. The exit status is 1 if an impact is further off than
`ALLOWED`. Without Siconos or a compiler, one line says so and nothing is compared.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from itertools import product
from math import cos, sin
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dimersweep.kernel.batch import run_many
from dimersweep.kernel.compiler.jit import exported
from dimersweep.kernel.impact.impact import double_impact
from dimersweep.kernel.model.layout import CODES, N1, N2, N_CODES, N_OUT, N_STATE, OK
from dimersweep.kernel.numerics.steps import copy
from dimersweep.parameters import Parameters
from tests.checks.scenes import SCALE, engine_states
from tests.checks.verbs import dimer, scratch, state_of
from tests.oracle.body import dimer as constants_of

law = import_module("tests.oracle.impact")  # the package has a function of the same name
INSTALL = "apt-get install g++ libsiconos-kernel-dev"
FOLDERS = ("", "kernel", "numerics", "externals")
STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of impulse, in units of mass times approach speed
ALLOWED = 10.0  # error of an impact, in units of its step and the approach speed
ETAS, RATIOS = (1.0, 1.5, 2.0), (0.5, 1.0, 2.0)
RTOLS = 10.0 ** -np.arange(3, 13)
SMOOTH = {"mu": 0.0, "mu_s": 0.0}
UNLIKE = SMOOTH | {"r_2": 4e-3, "rho_b_2": 5000.0, "e_1": 0.8, "e_2": 0.5}
LANDINGS = ((0.0, -1.0), (-1.0, -0.4))  # gap rates before: p1 rests on the plate; both ends land
LEVEL = {"Gamma": 2.5, "e_1": 0.9, "e_2": 0.7, "rho_b_2": 4000.0, "k_ratio": 2.0, "beta0": 0.0}  # begins at both ends
RUNS = {"strong forcing, unlike ends": SMOOTH | LEVEL, "base case without friction": SMOOTH}
PERIODS, SAMPLES = 2, 8  # forcing periods of a run, and its samples in each
CLOSED, TOLERANCE = 1e-12, 1e-11  # what Siconos takes for a closed gap [m]; relative and absolute, of its integrator
PLANAR = [2, 4, 8, 10]  # of the states of the reference runs: first gap, dip angle, their rates
COPIES = 16  # runs of a batch of the engine's


class Siconos:
    """The program `judge.cpp`, built in a folder.

    Raises
    ------
    FileNotFoundError
        Where there is no Siconos or no compiler.
    """

    def __init__(self, folder, prefix="/usr"):
        headers = Path(prefix, "include", "siconos")
        if not (headers / "kernel" / "MultipleImpact.hpp").exists():
            raise FileNotFoundError(f"siconos is not installed ({INSTALL})")
        self.program = Path(folder, "judge")
        command = ["g++", "-O2", "-std=c++17", "-w", Path(__file__).with_suffix(".cpp"), "-o", self.program]
        command += [f"-I{headers / part}" for part in FOLDERS]
        try:
            subprocess.run([*command, f"-L{prefix}/lib", "-lsiconos_kernel", "-lsiconos_numerics"], check=True)
        except FileNotFoundError:
            raise FileNotFoundError(f"g++ is not installed, which siconos needs ({INSTALL})") from None

    def ask(self, verb, *numbers):
        """What is said of a scene: rows of numbers, the processor time [s], why it ended early ("" if it did not)."""
        scene = " ".join(repr(float(value)) for value in np.concatenate([np.ravel(each) for each in numbers]))
        said = subprocess.run([self.program, verb], input=scene, check=True, capture_output=True, text=True).stdout
        *rows, (taken,) = [list(map(float, line[2:].split())) for line in said.splitlines() if line.startswith("> ")]
        stopped = "".join(line.partition(": ")[2] for line in said.splitlines() if line.startswith("stopped"))
        return np.array(rows), taken, stopped


class Impact(NamedTuple):
    """An impact at two contacts: masses, gap rates per velocity, restitutions, stiffnesses, exponent, velocities before."""

    masses: np.ndarray
    rows: np.ndarray
    e: tuple
    k: tuple
    eta: float
    before: np.ndarray

    def by_siconos(self, siconos, step):
        """Gap rates after it, and the time it takes [s]."""
        velocities, taken, _ = siconos.ask("impact", [step, self.masses.size], *self)
        return self.rows @ velocities[0], taken

    def directly(self):
        """Gap rates after it by direct integration of the law (`tests/oracle`)."""
        couple, rates = np.zeros((2, 3, 2, 3)), np.zeros((2, 3))
        couple[:, 0, :, 0], rates[:, 0] = self.rows / self.masses @ self.rows.T, self.rows @ self.before
        smooth = law.Law(self.e, (0.0, 0.0), (0.0, 0.0), self.k, self.eta)
        P, _ = law.resolve(couple, rates, smooth, np.array([1.0, 0.0]), 1e-13)
        return rates[:, 0] + couple[:, 0, :, 0] @ P[:, 0]


def row_of_balls(eta, ratio):
    """Three equal balls in a row, the first of which runs into the others; one contact is elastic, the other one is not."""
    return Impact(
        np.ones(3), np.array([[-1.0, 1, 0], [0, -1, 1]]), (1.0, 0.6), (1.0, ratio), eta, np.array([1.0, 0, 0])
    )


@exported
def struck(dm, before, rtol, state, modes, work, log, times):
    """Carry a state through an impact at both ends, so many times over; the status."""
    for _ in range(times):
        copy(before, state, N_STATE)
        status, _ = double_impact(dm, state, -min(before[N1], before[N2]), rtol, modes, work, log)
    return status


class Landing:
    """A frictionless dimer, level on the plate, with these gap rates and 1 m/s along the plate, across its axis.

    Siconos, which lacks what moves along the plate, has it in units of its mass and length.
    """

    def __init__(self, scene, rates):
        d = constants_of(scene)
        rows = np.column_stack([np.ones(2), np.array([-d.h, d.l - d.h]) / d.l * cos(d.beta_0)])
        self.impact = Impact(
            np.array([1.0, d.J1 / (d.m * d.l**2)]), rows, d.e, d.k, d.eta, np.linalg.solve(rows, rates)
        )
        dm, (work, log) = dimer(**scene), scratch()
        dip_rate = (rates[1] - rates[0]) / (d.l * cos(d.beta_0))
        self.state = np.zeros(N_STATE)
        self.scene = dm, state_of(dm, np.zeros(6), [1, 0, rates[0], 0, dip_rate, 0])
        self.space = self.state, np.zeros(2), work, log

    def by_engine(self, rtol, times=1):
        """Gap rates after it, computed so many times over."""
        assert struck(*self.scene, rtol, *self.space, times) == OK
        return self.state[[N1, N2]]


class Run:
    """A planar frictionless dimer from its release, in samples."""

    def __init__(self, scene):
        self.scene, self.d = Parameters(**scene).given(), constants_of(scene)
        self.times = np.arange(1, SAMPLES * PERIODS + 1) / (SAMPLES * self.scene["f"])
        self.rows = np.tile(Parameters(**scene).row(), (COPIES, 1))
        self.out, self.codes = np.zeros((COPIES, N_OUT)), np.zeros((COPIES, N_CODES), np.int64)

    def by_siconos(self, siconos, step):
        """Times of impacts; states at the samples that it comes to, shape (n, 4); its time [s]; why it ended early."""
        d, beta0 = self.d, self.scene["beta0"]
        constants = [d.m, d.J1, -d.h, d.l - d.h, *d.r, *d.e, *d.k, d.eta, d.g, d.A[2] * d.omega**2, d.omega, d.phi[2]]
        start = [d.r[0] + d.h * sin(beta0), beta0, -d.A[2] * d.omega * cos(d.phi[2]), 0.0]
        how = [step * d.m, TOLERANCE, CLOSED, self.times[0], self.times[-1]]
        rows, taken, stopped = siconos.ask("run", constants, start, how)
        t, z, beta, z_rate, beta_rate = rows.T
        states = [z - d.h * np.sin(beta) - d.r[0], beta, z_rate - d.h * np.cos(beta) * beta_rate, beta_rate]
        sample = (np.abs(t[:, None] - self.times) < 1e-12).any(axis=1)
        return t[~sample], np.column_stack(states)[sample], taken, stopped

    def by_engine(self, rtol):
        """States at the samples, shape (n, 4)."""
        return engine_states(self.scene, self.times, rtol)[0][:, PLANAR]

    def in_batches(self, rtol, times):
        """The runs as a sweep makes them, so many times over."""
        for _ in range(times):
            run_many(self.rows, PERIODS, rtol, False, self.out, self.codes)
        assert (self.codes[:, CODES.index("status")] == OK).all()


def seconds(action, rtol, times):
    """Processor time of one of so many calls of an action, the least of five timings [s]."""
    action(rtol, 1)
    taken = []
    for _ in range(5):
        begun = time.process_time()
        action(rtol, times)
        taken.append((time.process_time() - begun) / times)
    return min(taken)


def tell_equal(step, error, taken, errors, times):
    """Print the time of Siconos, and that of the engine where it is no further off, at the `rtol` that is the quickest."""
    said = f"  step {step:.0e}: error {error:.1e}, {taken:.3g} s"
    able = [rtol for rtol in RTOLS if errors[rtol] <= error]
    if able:
        rtol = min(able, key=times.__getitem__)
        said += f"; engine at rtol {rtol:.0e}: error {errors[rtol]:.1e}, {1e6 * times[rtol]:.3g} us"
        said += f"; {taken / times[rtol]:,.0f} times"
    print(said, flush=True)


def judge_balls(siconos, steps):
    """Compare impacts of balls with direct integration; the largest errors in units of the steps."""
    cases = [row_of_balls(*each) for each in product(ETAS, RATIOS)]
    expected = [case.directly() for case in cases]
    print(f"three balls in a row, {len(cases)} impacts: largest error of a gap rate, in the speed of the first ball")
    over = []
    for step in steps:
        error = max(
            np.abs(case.by_siconos(siconos, step)[0] - end).max() for case, end in zip(cases, expected, strict=True)
        )
        over.append(error / step)
        print(f"  step {step:.0e}: error {error:.1e}", flush=True)
    return over


def judge_landings(siconos, steps):
    """Compare impacts of a dimer with the engine's; the largest errors in units of the steps."""
    scenes = [UNLIKE | {"eta": eta, "k_ratio": ratio} for eta, ratio in product(ETAS, RATIOS)]
    cases = [Landing(scene, rates) for scene in scenes for rates in LANDINGS]
    expected = np.array([case.by_engine(1e-12) for case in cases])
    apart = max(np.abs(case.impact.directly() - end).max() for case, end in zip(cases, expected, strict=True))
    print(f"dimer of unlike ends, {len(cases)} impacts at both: largest error of a gap rate, in the approach speed")
    print(f"  engine at rtol 1e-12 and direct integration: {apart:.1e} apart")
    errors = {rtol: np.abs([case.by_engine(rtol) for case in cases] - expected).max() for rtol in RTOLS}
    times = {rtol: np.mean([seconds(case.by_engine, rtol, 200) for case in cases]) for rtol in RTOLS}
    over = []
    for step in steps:
        found, taken = zip(*(case.impact.by_siconos(siconos, step) for case in cases), strict=True)
        error = np.abs(found - expected).max()
        over.append(error / step)
        tell_equal(step, error, np.mean(taken), errors, times)
    return over


def judge_run(siconos, name, steps):
    """Compare a run with the engine's as far as Siconos comes; the largest errors in units of the steps."""
    run, scale, over = Run(RUNS[name]), SCALE[PLANAR], []
    expected = run.by_engine(1e-12)
    errors = {rtol: (np.abs(run.by_engine(rtol) - expected) / scale).max() for rtol in RTOLS}
    times = {rtol: seconds(run.in_batches, rtol, 4) / COPIES for rtol in RTOLS}
    print(f"planar run, {name}: largest error of the states at {len(expected)} samples, in their scales")
    for step in steps:
        impacts, states, taken, stopped = run.by_siconos(siconos, step)
        error = (np.abs(states - expected[: len(states)]) / scale).max()
        over.append(error / step)
        if stopped:
            end = f"ends after {len(impacts)} impacts, at {impacts[-1] * run.scene['f']:.4f} periods: {stopped}"
            print(f"  step {step:.0e}: error {error:.1e} at {len(states)} samples; {end}", flush=True)
        else:
            tell_equal(step, error, taken, errors, times)
    return over


def main():
    """Build, compare and tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="coarse steps of impulse only")
    parser.add_argument("--prefix", default="/usr", help="where Siconos is installed")
    given = parser.parse_args()
    steps = STEPS[: 2 if given.small else None]
    with tempfile.TemporaryDirectory() as folder:
        try:
            siconos = Siconos(folder, given.prefix)
        except FileNotFoundError as missing:
            print(f"left out: {missing}")
            return 0
        over = judge_balls(siconos, steps) + judge_landings(siconos, steps)
        for name in RUNS:
            judge_run(siconos, name, steps)
    return int(max(over) > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())

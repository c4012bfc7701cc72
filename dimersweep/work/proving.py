"""Whether the kernel works and rounds as it must: what is known to come out, run before any work is given to it.

Results are compared by nothing but the sources, so each process proves that its compiler and its processor keep to them: the
bits of known scenes, and of elementary functions at arguments where a product that is rounded on its own changes the last one.
`benchmarks/evidence/fusings.py` has chosen both, and tells what they see.
"""

import hashlib
import os
import platform
import threading
import warnings
from functools import cache
from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.errors import KernelError
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.compiler.versions import compiler
from dimersweep.kernel.compiler.ways import PYTHON, way
from dimersweep.kernel.model.layout import CODE_MODE, MODES, V_RADIUS
from dimersweep.kernel.numerics.elementary import functions
from dimersweep.parameters import Parameters

PROOF_PERIODS, PROOF_RTOL, UNCOMPILED = 100, 1e-8, 3
OTHER_PHYSICS = "DIMERSWEEP_OTHER_PHYSICS"  # set by who has changed the sources of the kernel, and means it


class Scene(NamedTuple):
    """Parameters that differ from the base case, the mode that they lead to, and a checksum of all that comes out."""

    parameters: dict[str, float]
    mode: str
    bits: str


# fmt: off
SCENES = (
    Scene({}, "drift", "04376d863a55fb6a"),
    Scene({"Gamma": 0.5}, "rest", "9e1eb9c3f959f914"),
    Scene({"Gamma": 1.2, "beta0": 0.8}, "jump", "8a861893f394e437"),
    Scene({"e_2": 0.76, "mu": 0.29}, "drift", "8cd090f1b4f23067"),
    Scene({"mu": 0.38, "r_2": 0.0037, "Gamma_x": 0.46, "Gamma": 2.3}, "aperiodic", "f0d24b8c3a6e078e"),
    Scene({"r_2": 0.0039, "f": 11.0, "mu_s": 0.4, "mu": 0.084, "mu_2": 0.052}, "rest", "dd04e5aa4948054f"),
    Scene(
        {"e": 0.61, "gammadot0": -21.0, "Gamma_2": 0.43, "mu": 0.31, "mu_s": 0.7, "thetadot0": 8.3}, "drift", "d45b90b90a8f53a4"
    ),
    Scene({"gammadot0": -19.0, "eta": 1.2, "ydot0": -0.71}, "drift", "628408b0a9d9c7c8"),
    Scene({"e": 0.97, "gammadot0": -40.0, "mu": 0.28}, "aperiodic", "5c8f69e5b7a89de1"),
    Scene({"e_2": 0.66, "tilt": 0.3, "Gamma_x": 0.17, "gammadot0": -32.0, "Gamma_2": 1.4}, "aperiodic", "c6c505e7cc77ad1a"),
)
UNITS = 1 << 24  # of one
ARGUMENTS = (  # in these
    -90798179, -78082627, -50465430, -24065755, -20649817, -11834731, 5415036, 6139260, 17721299,
    29451603, 38996590, 40424286, 40937386, 67156165, 88416236, 112098468, 115597889, 120194660,
)
FUNCTION_BITS = "4300f402ee76948b"
# fmt: on

_LOCK = threading.Lock()


def is_proven() -> bool:
    """Whether `prove` has been through, so that it costs nothing."""
    return proof.cache_info().currsize > 0


def prove() -> None:
    """Run `SCENES`, once in a process: of many threads that ask, one does it for all.

    A kernel whose sources were changed, as by who tries another physics, gives other numbers: where `OTHER_PHYSICS` is set, a
    warning says so, and that is all.

    Raises
    ------
    KernelError
        If the kernel raises, or gives other numbers than are known, with the processor and the versions that it is of.
    """
    with _LOCK:
        proof()


@cache
def proof() -> None:
    """See `prove`."""
    try:
        out, codes = outcomes()
        wrong = [told for each in zip(SCENES, out, codes, strict=False) if (told := _difference(*each))]
        if bits_of(functions(np.array(ARGUMENTS) / UNITS)) != FUNCTION_BITS:
            wrong.append("gives other last digits of elementary functions")
    except Exception as error:  # whatever the compiler, its cache or the machine leads to
        raise KernelError(f"kernel: cannot run here ({type(error).__name__}: {error})") from error
    if wrong and not os.environ.get(OTHER_PHYSICS):
        raise KernelError(
            f"kernel: {wrong[0]} on {machine()}; it must not be used. "
            f"If its sources were changed on purpose, set {OTHER_PHYSICS}=1"
        )
    if wrong:
        warnings.warn(f"kernel: {wrong[0]}; {OTHER_PHYSICS} is set", RuntimeWarning, stacklevel=2)


def outcomes() -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers and codes that `SCENES` come to, shapes (n, N_OUT) and (n, N_CODES); without the JIT the first few."""
    scenes = SCENES[:UNCOMPILED] if way() == PYTHON else SCENES  # Python takes seconds, and has no compiler to prove
    rows = np.array([Parameters(**scene.parameters).row() for scene in scenes])
    out, codes = blank(len(rows))
    run_many(rows, PROOF_PERIODS, PROOF_RTOL, True, out, codes)
    return out, codes


def bits_of(*arrays: np.ndarray) -> str:
    """A checksum of all bits of some arrays."""
    return hashlib.sha256(
        b"".join(array.astype(array.dtype.newbyteorder("<")).tobytes() for array in arrays)
    ).hexdigest()[:16]


def _difference(scene: Scene, out: np.ndarray, codes: np.ndarray) -> str:
    """What a scene came to in place of what is known of it; "" if that is the same."""
    what = ", ".join(f"{name} = {value}" for name, value in scene.parameters.items()) or "the base case"
    mode = codes[CODE_MODE]
    if mode != MODES.index(scene.mode):
        return f"gives {MODES[mode] if 0 <= mode < len(MODES) else mode} in place of {scene.mode} for {what}"
    radius = f" (radius {out[V_RADIUS]:.17g})" if scene.mode == "drift" else ""
    return f"gives other digits for {what}{radius}" if bits_of(out, codes) != scene.bits else ""


def machine() -> str:
    """The processor, and what makes code of the kernel for it."""
    from llvmlite import binding

    made = compiler(way())
    versions = ", ".join(f"{name} {made[name]}" for name in ("python", "numba", "llvmlite", "numpy"))
    processor = f"{platform.machine()} ({binding.get_host_cpu_name()})"
    return f"{processor} with {versions}, compiled the {made['way']} way for {made['target']}"

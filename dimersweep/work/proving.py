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
from dimersweep.kernel.compiler.ways import way
from dimersweep.kernel.model.layout import CODE_MODE, MODES, V_RADIUS
from dimersweep.kernel.numerics.elementary import functions
from dimersweep.parameters import Parameters

PROOF_PERIODS, PROOF_RTOL = 100, 1e-8
OTHER_PHYSICS = "DIMERSWEEP_OTHER_PHYSICS"  # set by who has changed the sources of the kernel, and means it


class Scene(NamedTuple):
    """Parameters that differ from the base case, the mode that they lead to, and a checksum of all that comes out."""

    parameters: dict[str, float]
    mode: str
    bits: str


SCENES = (
    Scene({}, "drift", ""),
    Scene({"Gamma": 0.5}, "rest", ""),
    Scene({"Gamma": 1.2, "beta0": 0.8}, "jump", ""),
)
ARGUMENTS = ((1.0, 1.0),)  # x and y
FUNCTION_BITS = ""

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
        wrong = [told for each in zip(SCENES, out, codes, strict=True) if (told := _difference(*each))]
        if bits_of(functions(*np.array(ARGUMENTS).T)) != FUNCTION_BITS:
            wrong.append("gives other last digits of elementary functions")
    except Exception as error:  # whatever the compiler, its cache or the machine leads to
        raise KernelError(f"kernel: cannot run here ({type(error).__name__}: {error})") from error
    if wrong and not os.environ.get(OTHER_PHYSICS):
        raise KernelError(
            f"kernel: {wrong[0]} on {_machine()}; it must not be used. "
            f"If its sources were changed on purpose, set {OTHER_PHYSICS}=1"
        )
    if wrong:
        warnings.warn(f"kernel: {wrong[0]}; {OTHER_PHYSICS} is set", RuntimeWarning, stacklevel=2)


def outcomes() -> tuple[np.ndarray, np.ndarray]:
    """What `SCENES` come to, as the kernel gives it: shapes (n, N_OUT) and (n, N_CODES)."""
    rows = np.array([Parameters(**scene.parameters).row() for scene in SCENES])
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


def _machine() -> str:
    """The processor, and what makes code of the kernel for it."""
    from llvmlite import binding

    made = compiler(way())
    versions = ", ".join(f"{name} {made[name]}" for name in ("python", "numba", "llvmlite", "numpy"))
    processor = f"{platform.machine()} ({binding.get_host_cpu_name()})"
    return f"{processor} with {versions}, compiled the {made['way']} way for {made['target']}"

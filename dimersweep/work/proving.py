"""Prove, before any work, that the kernel runs in this process and rounds as it must, by scenes with known bits.

The version of results depends on the sources alone. So each process proves that its compiler and its processor keep to
them. It compares the bits of known scenes, and of elementary functions at arguments where a product that is rounded by
itself changes the last bit. `benchmarks/evidence/fusings.py` chose both, wrote them into ``known.json``, and says
which faults they show.
"""

import hashlib
import json
import os
import platform
import threading
from pathlib import Path
from typing import Any

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.errors import KernelError
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.compiler.cache import warn
from dimersweep.kernel.compiler.pipelines import PYTHON, pipeline
from dimersweep.kernel.compiler.versions import compiler
from dimersweep.kernel.model.layout import CODE_MODE, MODES, V_RADIUS
from dimersweep.kernel.numerics.elementary import functions
from dimersweep.parameters import Parameters

PROOF_PERIODS, PROOF_RTOL = 100, 1e-8  # periods and rtol of the scenes, as in ``known.json``
OTHER_PHYSICS = "DIMERSWEEP_OTHER_PHYSICS"  # environment variable for those who change the kernel's sources on purpose
KNOWN = json.loads(Path(__file__).with_name("known.json").read_text())
SCENES, ARGUMENTS = KNOWN["scenes"], KNOWN["arguments"]
_LOCK, PROVEN = threading.Lock(), threading.Event()


def is_proven() -> bool:
    """Return True if `prove` has succeeded in this process."""
    return PROVEN.is_set()


def prove() -> None:
    """Run `SCENES` and compare their bits, once in a process: of several threads, one does it for all.

    A kernel whose sources were changed, say to try another physics, gives other numbers. If `OTHER_PHYSICS` is set, a
    warning says so, and no error is raised.

    Raises
    ------
    KernelError
        If the kernel raises, or gives other numbers; the message names the processor and the versions.
    """
    with _LOCK:
        if not is_proven():
            _prove()
            PROVEN.set()


def _prove() -> None:
    try:
        wrong = [line for each in zip(SCENES, *outcomes(), strict=False) if (line := _difference(*each))]
        if bits_of(functions(ARGUMENTS)) != KNOWN["functions"]:
            wrong.append("gives other last digits of elementary functions")
    except Exception as error:  # of any kind: from the compiler, its cache or the machine
        raise KernelError(f"kernel: cannot run here ({type(error).__name__}: {error})") from error
    if wrong and not os.environ.get(OTHER_PHYSICS):
        raise KernelError(
            f"kernel: {wrong[0]} on {machine()}; it must not be used. "
            f"If its sources were changed on purpose, set {OTHER_PHYSICS}=1"
        )
    if wrong:
        warn(f"kernel: {wrong[0]}; {OTHER_PHYSICS} is set")


def outcomes() -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers and codes that `SCENES` come to, shapes (n, N_OUT) and (n, N_CODES).

    Without the JIT it is the first scene only.
    """
    # Python takes seconds for a scene, and has no compiler to prove
    scenes = SCENES[:1] if pipeline() == PYTHON else SCENES
    rows = np.array([Parameters(**scene["parameters"]).row() for scene in scenes])
    out, codes = blank(len(rows))
    run_many(rows, PROOF_PERIODS, PROOF_RTOL, True, out, codes)
    return out, codes


def bits_of(*arrays: np.ndarray) -> str:
    """Return a checksum of all bits of some arrays, the same on machines of either byte order."""
    every = b"".join(array.astype(array.dtype.newbyteorder("<")).tobytes() for array in arrays)
    return hashlib.sha256(every).hexdigest()[:16]


def _difference(scene: dict[str, Any], out: np.ndarray, codes: np.ndarray) -> str:
    """Return in words how the results of a scene differ from the known ones; "" if they are the same."""
    if bits_of(out, codes) == scene["bits"]:
        return ""
    what = ", ".join(f"{name} = {value}" for name, value in scene["parameters"].items()) or "the base case"
    return f"gives other digits for {what} (radius {out[V_RADIUS]:.17g}, {MODES[codes[CODE_MODE]]})"


def machine() -> str:
    """Return the name of the processor, and the versions that make code of the kernel for it."""
    from llvmlite import binding

    made = compiler(pipeline())
    packages = ", ".join(f"{name} {made[name]}" for name in ("python", "numba", "llvmlite", "numpy"))
    code = f"{packages}, compiled the {made['way']} way for {made['target']}"
    return f"{platform.machine()} ({binding.get_host_cpu_name()}) with {code}"

"""Whether the kernel works: known scenes, each with the numbers that must come out, run before any work is given to it."""

import os
import threading
import warnings
from functools import cache
from typing import NamedTuple

import numpy as np

from dimersweep.cubes.cube import blank
from dimersweep.errors import KernelError
from dimersweep.kernel.batch import run_many
from dimersweep.kernel.model.layout import CODE_MODE, MODES, OUT
from dimersweep.parameters import Parameters

CLOSE = 1e-4  # relative; the numbers are known to 1e-7, and a kernel that is damaged is far off
PROOF_PERIODS, PROOF_RTOL = 100, 1e-8
OTHER_PHYSICS = "DIMERSWEEP_OTHER_PHYSICS"  # set by who has changed the sources of the kernel, and means it


class Scene(NamedTuple):
    """Parameters that differ from the base case, the mode that they lead to, and numbers of its motion."""

    parameters: dict[str, float]
    mode: str
    numbers: dict[str, float]


SCENES = (  # numbers at rtol 1e-11
    Scene({}, "drift", {"radius": 4.2447157, "zeta": 1.6042314, "impact_phase": 0.08090007, "settled_after": 22.0}),
    Scene({"Gamma": 0.5}, "rest", {"down_share_1": 1.0}),
    Scene({"Gamma": 1.2, "beta0": 0.8}, "jump", {"down_share_1": 1.0, "settled_after": 4.0}),
)

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
        If the kernel raises, or gives other numbers than are known.
    """
    with _LOCK:
        proof()


@cache
def proof() -> None:
    """See `prove`."""
    try:
        out, codes = outcomes()
    except Exception as error:  # whatever the compiler, its cache or the machine leads to
        raise KernelError(f"kernel: cannot run here ({type(error).__name__}: {error})") from error
    wrong = next(filter(None, map(_difference, SCENES, out, codes[:, CODE_MODE])), "")
    if wrong and not os.environ.get(OTHER_PHYSICS):
        raise KernelError(
            f"kernel: {wrong}; it must not be used. If its sources were changed on purpose, set {OTHER_PHYSICS}=1"
        )
    if wrong:
        warnings.warn(f"kernel: {wrong}; {OTHER_PHYSICS} is set", RuntimeWarning, stacklevel=2)


def outcomes() -> tuple[np.ndarray, np.ndarray]:
    """What `SCENES` come to, as the kernel gives it: shapes (n, N_OUT) and (n, N_CODES)."""
    rows = np.array([Parameters(**scene.parameters).row() for scene in SCENES])
    out, codes = blank(len(rows))
    run_many(rows, PROOF_PERIODS, PROOF_RTOL, True, out, codes)
    return out, codes


def _difference(scene: Scene, floats: np.ndarray, mode: int) -> str:
    """What a scene came to in place of what is known of it; "" if that is the same."""
    what = ", ".join(f"{name} = {value}" for name, value in scene.parameters.items()) or "the base case"
    if mode != MODES.index(scene.mode):
        word = MODES[mode] if 0 <= mode < len(MODES) else mode
        return f"gives {word} in place of {scene.mode} for {what}"
    given = dict(zip(OUT, floats.tolist(), strict=True))
    for name, value in scene.numbers.items():
        if not abs(given[name] - value) <= CLOSE * value:
            return f"gives {name} {given[name]:.8g} in place of {value:.8g} for {what}"
    return ""

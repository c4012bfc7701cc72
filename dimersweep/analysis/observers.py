"""The observer of sustained spins, for `sweep(..., sustained=True)`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dimersweep.analysis.orbits.slow.sustained import sustained
from dimersweep.cubes.cube import names
from dimersweep.cubes.results import Field
from dimersweep.errors import OrbitError
from dimersweep.extensions import ORBITS_CODE
from dimersweep.kernel import kernel_version
from dimersweep.kernel.batch import Workspace, is_stopped
from dimersweep.kernel.model.layout import OUT, ROW
from dimersweep.studies.observers import FinishedRuns, Observer
from dimersweep.symbols import QUANTITIES


@dataclass(frozen=True)
class Sustained(Observer):
    """The number of sustained spins of each dimer, and the circle of one that attracts.

    Of several that attract it is the one nearest to the spin of the run, or the least where the run has no spin.
    """

    fields = (
        Field("sustained", QUANTITIES["sustained"], "<i8"),
        *(Field(f"sustained_{name}", QUANTITIES[f"sustained_{name}"]) for name in ("spin", "radius", "time")),
    )

    def settings(self) -> dict[str, Any]:
        """Return the switch of `sweep` that asks for this observer, and the version of results with orbits."""
        return {"sustained": True, "kernel_version": kernel_version(*ORBITS_CODE)}

    def observe(self, runs: FinishedRuns, space: Workspace) -> None:
        """Compute the sustained spins of each point, and record their number and the attracting circle."""
        for row, result in zip(runs.rows, runs.results, strict=True):
            if is_stopped(space):
                return
            try:  # without a guess from neighbours: numbers must not depend on how a grid is cut into tiles
                found = sustained(**dict(zip(ROW, row.tolist(), strict=True)))
            except OrbitError:
                continue
            result["sustained"] = (names(found["kind"]) != "cycle").sum()
            attracts = found.isel(sustained=found["attracts"].values)
            if attracts.sizes["sustained"]:
                off = np.abs(attracts["spin"].values - abs(result["out"][OUT.index("spin")]))
                for name, of in (("spin", "spin_low"), ("radius", "radius"), ("time", "slow_time")):
                    result[f"sustained_{name}"] = attracts[of].values[off.argmin()]

"""The map of borders or branches of orbits, for a page."""

from typing import Any

import numpy as np
import xarray as xr

from dimersweep.analysis.orbits.continuation.kinds import BORDER_KINDS
from dimersweep.cubes.cube import column
from dimersweep.errors import ParameterError
from dimersweep.exploring.mapping import CubeMap, place_of
from dimersweep.plots.style import MODE_COLORS, fixed_of
from dimersweep.runs.run import Run
from dimersweep.runs.simulating import simulate
from dimersweep.symbols import PARAMETERS, START

STABILITY = {"stable": MODE_COLORS["drift"], "unstable": MODE_COLORS["rest"]}


class BorderMap(CubeMap):
    """The map of points of borders or branches, in the colours of their kinds, in parts that a page asks for."""

    def __init__(self, table: xr.Dataset) -> None:
        parameter = table.attrs.get("parameter")
        if parameter not in PARAMETERS:
            kind = table.attrs.get("what", "orbits")
            raise ParameterError(f"explore: a table of {kind} has no map; give borders or branches over a parameter")
        frame = table.dimersweep.to_dataframe().reset_index()
        varied = [name for name in PARAMETERS if name in frame and frame[name].nunique() > 1]
        self.axes = ["radius", parameter] if varied == [parameter] else sorted(varied, key=[parameter, *varied].index)
        known = np.isfinite(frame[[parameter, *self.axes]]).all(axis=1)  # orbits in a plane have no radius
        frame = frame[known].reset_index(drop=True)
        stability = frame["stable"].map({True: "stable", False: "unstable"})
        words = frame.get("kind", stability if "kind" not in table.attrs else [table.attrs["kind"]] * len(frame))
        self.labels = sorted(set(words))
        self.colors = [BORDER_KINDS[word].color if word in BORDER_KINDS else STABILITY[word] for word in self.labels]
        self.cube = frame.rename_axis("point").to_xarray().assign_attrs(table.attrs)
        self.cube["mode"] = column("point", words, "kind of border, or stability", self.labels)
        self.mode, self.dims, self.points, self.fixed, self.shown = self.cube["mode"], ["point"], True, [], ["mode"]
        self.shared = fixed_of(table)[0]

    def parameters_at(self, point: xr.Dataset) -> dict[str, float]:
        """Return the parameters of a point without those of a start, since its orbit is the same for any start."""
        given = {name: point[name].item() for name in PARAMETERS if name in point}
        return {name: value for name, value in (self.shared | given).items() if name not in START}

    def run(self, at: str) -> tuple[Run, dict[str, Any]]:
        """Return a run with the parameters of a point, and its settings."""
        row = self.cube.isel(point=place_of("point", at, self.mode.size))
        settings: dict[str, Any] = {"periods": 200, "rtol": 1e-8, "stop_when_settled": True}
        given: dict[str, Any] = {name: row[name].item() for name in PARAMETERS if name in row}
        return simulate(**self.shared | given, **settings), settings

"""Sweeps declared in a file: TOML in, checked for unknown words, and ready to be handed to `sweep`."""

import os
import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dimersweep.errors import ParameterError
from dimersweep.parameters import check_count, check_rtol
from dimersweep.studies import search as searching
from dimersweep.studies import sweep_spec
from dimersweep.studies.deciding import SearchSpec
from dimersweep.studies.refine import RefineSpec, check_refinement
from dimersweep.studies.sweep_spec import Spec


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class SweepSection(_Section):
    """What to compute and where to put it."""

    title: str
    periods: int
    max_periods: int | None = None
    rtol: float = 1e-8
    stop_when_settled: bool = True
    certify: bool = False
    strobes: int = 0
    output: str


class SearchSection(_Section):
    """A question about one axis, in place of every point of it."""

    over: str
    ask: Literal["any", "all", "first", "fraction"] = "any"
    mode: str = "drift"
    orbit_periods: int = 0


class RefineSection(_Section):
    """How far a map is refined, and at which boundaries."""

    halvings: dict[str, int]
    between: list[str] | None = None


class PathsSection(_Section):
    """How much of the path of the centre of mass is kept of each run."""

    periods: int
    per_period: int = 8


class PlotSection(_Section):
    """How to draw the cube."""

    kind: Literal[
        "segments",
        "mode_map",
        "regions",
        "paths",
        "trends",
        "minimum",
        "impact_ends",
        "shares",
        "planar",
        "bifurcation",
    ] = "mode_map"


class Declaration(_Section):
    """One sweep, search or refined map as a file declares it."""

    sweep: SweepSection
    grid: dict[str, Any]
    fixed: dict[str, Any] = Field(default_factory=dict)
    search: SearchSection | None = None
    refine: RefineSection | None = None
    paths: PathsSection | None = None
    plot: PlotSection = Field(default_factory=PlotSection)

    def study(
        self, *, periods: int | None = None, rtol: float | None = None, certify: bool = False
    ) -> Spec | SearchSpec | RefineSpec:
        """What the sections say together, judged.

        Parameters
        ----------
        periods, rtol : int, float, optional
            In place of the declared ones; `periods` in place of the declared ``max_periods`` too.
        certify : bool
            Whether to certify what was not declared to be, see `sweep`.

        Raises
        ------
        ParameterError
        """
        given: dict[str, Any] = {
            "periods": check_count("sweep.periods", self.sweep.periods) if periods is None else periods,
            "max_periods": self.sweep.max_periods if periods is None else None,
            "rtol": check_rtol(self.sweep.rtol) if rtol is None else rtol,
        }
        certify = certify or self.sweep.certify
        if self.search is None:
            if self.refine or self.paths:
                raise ParameterError("search: is missing; refine and paths go with a search")
            given |= {"stop_when_settled": self.sweep.stop_when_settled, "certify": certify}
            given["strobes"] = self.sweep.strobes
            return sweep_spec.make_spec(self.grid, self.fixed, **given)
        if self.sweep.strobes:
            raise ParameterError(f"sweep.strobes = {self.sweep.strobes}: is for sweeps of a whole grid")
        if certify:
            raise ParameterError("certify: is for sweeps of a whole grid; a search does not take it")
        if not self.sweep.stop_when_settled:
            raise ParameterError("sweep.stop_when_settled = false: a search stops each run that has settled")
        paths = None if self.paths is None else self.paths.model_dump()
        question = searching.make_spec(self.grid, self.fixed, paths=paths, **self.search.model_dump(), **given)
        if self.refine is None:
            return question
        return RefineSpec(question, *check_refinement(question, **self.refine.model_dump()))

    @property
    def attrs(self) -> dict[str, str]:
        """Attributes of the cube."""
        return {"title": self.sweep.title, "plot": self.plot.kind}


_KNOWN: dict[str, type[BaseModel]] = {
    "": Declaration,
    "sweep": SweepSection,
    "search": SearchSection,
    "refine": RefineSection,
    "paths": PathsSection,
    "plot": PlotSection,
}


def _explain(error: ValidationError) -> str:
    """The first complaint of pydantic as one line with the key and what is allowed."""
    # a misspelt key is also a missing one: name the spelling first
    first = min(error.errors(), key=lambda complaint: complaint["type"] != "extra_forbidden")
    *section, key = (str(part) for part in first["loc"])
    where = ".".join([*section, key])
    if first["type"] == "extra_forbidden":
        allowed = ", ".join(_KNOWN[".".join(section)].model_fields)
        return f"{where}: unknown key (allowed: {allowed})"
    if first["type"] == "missing":
        return f"{where}: is missing"
    return f"{where} = {first['input']!r}: {first['msg'].replace('Input should', 'must')}"


def read_declaration(path: str | os.PathLike[str]) -> Declaration:
    """Read and judge a sweep file.

    Parameters
    ----------
    path : path-like
        TOML with the sections ``[sweep]``, ``[grid]``, and optionally ``[fixed]``, ``[search]``, ``[refine]``,
        ``[paths]`` and ``[plot]``.

    Returns
    -------
    Declaration

    Raises
    ------
    ParameterError
        One line with the file, the key and what is allowed.
    """
    path = Path(path)
    try:
        declaration = Declaration.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
        declaration.study()
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror})") from None
    except RecursionError:
        raise ParameterError(f"{path}: is nested too deeply") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path}: is no valid TOML ({error})") from None
    except ValidationError as error:
        raise ParameterError(f"{path}: {_explain(error)}") from None
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    return declaration

"""Sweeps declared in a file: TOML in, checked for unknown words, and ready to be handed to `sweep`."""

import os
import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dimersweep.errors import ParameterError
from dimersweep.grid import Grid, make_grid
from dimersweep.parameters import check_count, check_rtol


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class SweepSection(_Section):
    """What to compute and where to put it."""

    title: str
    periods: int
    rtol: float = 1e-8
    stop_when_settled: bool = True
    output: str


class PlotSection(_Section):
    """How to draw the cube."""

    kind: Literal["segments", "mode_map"] = "mode_map"


class Declaration(_Section):
    """One sweep as a file declares it; `grid` and `fixed` are judged by `make_grid`."""

    sweep: SweepSection
    grid: dict[str, Any]
    fixed: dict[str, Any] = Field(default_factory=dict)
    plot: PlotSection = Field(default_factory=PlotSection)

    def points(self) -> Grid:
        """The declared grid."""
        return make_grid(self.grid, self.fixed)


_KNOWN: dict[str, type[BaseModel]] = {"": Declaration, "sweep": SweepSection, "plot": PlotSection}


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
        TOML with the sections ``[sweep]``, ``[grid]``, and optionally ``[fixed]`` and ``[plot]``.

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
        declaration.points()
        check_count("sweep.periods", declaration.sweep.periods)
        check_rtol(declaration.sweep.rtol)
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path}: is no valid TOML ({error})") from None
    except ValidationError as error:
        raise ParameterError(f"{path}: {_explain(error)}") from None
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    return declaration

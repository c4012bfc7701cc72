"""Declare what pictures and estimates of errors need of a run: `SeenRun`, with checks and words of a run."""

from collections.abc import Collection
from typing import Any, Protocol

import xarray as xr

from dimersweep.errors import ParameterError
from dimersweep.symbols import DI_END_MEANINGS, MODE_MEANINGS, MOTIONS_PAGE, TRACK_MEANINGS


class SeenRun(Protocol):
    """Protocol of a run, as pictures and estimates of errors use it; `Run` describes each attribute."""

    @property
    def status(self) -> str: ...
    @property
    def message(self) -> str: ...
    @property
    def mode(self) -> str: ...
    @property
    def mode_period(self) -> int: ...
    @property
    def track(self) -> str: ...
    @property
    def n_events(self) -> int: ...
    @property
    def n_periods(self) -> int: ...
    @property
    def end_speed(self) -> float: ...
    @property
    def orbit(self) -> Any: ...
    @property
    def parameters(self) -> dict[str, float]: ...
    @property
    def duration(self) -> float: ...
    @property
    def record_cut(self) -> str: ...
    @property
    def events(self) -> xr.Dataset: ...
    def record(self, wanted: str) -> Any: ...
    def conditions(self, always: Collection[str] = ..., *, tex: bool = False) -> str: ...
    def states(self, t: Any) -> xr.Dataset: ...
    def energy(self, by: Any = ...) -> xr.Dataset: ...
    def section(self, at: Any = ..., *, phase: Any = None) -> xr.Dataset: ...


def check_shown(run: SeenRun, wanted: str) -> None:
    """Raise `ParameterError` if there is nothing to show: no record, or less than a forcing period."""
    run.record(wanted)
    if not run.n_periods:
        raise ParameterError(
            f"{wanted}: there is nothing to show, the run ended before a forcing period ({run.message})"
        )


def meanings(run: SeenRun) -> dict[str, str]:
    """Return the meaning of each word of a run's verdict, by the word.

    The first is the meaning of the mode, with the page that says more.
    """
    di_end = run.orbit.di_end if run.orbit else "none"
    said = {run.mode: f"{MODE_MEANINGS[run.mode].replace('`', '')} ({MOTIONS_PAGE})"}
    said |= {run.track: TRACK_MEANINGS[run.track], di_end: DI_END_MEANINGS[di_end]}
    return {word: text for word, text in said.items() if word != "none"}

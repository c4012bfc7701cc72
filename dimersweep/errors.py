"""Errors that a user can mend: each message is one line with the name, the value and what is allowed."""

import re
from collections.abc import Iterable


class UserError(Exception):
    """Error that a user can mend: base of the errors of input, files, results and the machine."""


class ParameterError(UserError, ValueError):
    """Error of a parameter, an axis or a setting that the model does not allow.

    Examples
    --------
    >>> import dimersweep
    >>> try:
    ...     dimersweep.simulate(e=1.5)
    ... except dimersweep.ParameterError as error:
    ...     print(error)
    e = 1.5: must be in [0, 1]
    """


class AbsentError(ParameterError, AttributeError):
    """Error of an attribute that a run does not have; the message says what the run has instead."""


class OrbitError(UserError, RuntimeError):
    """Error of an orbit, a branch or a border that was not found; the message says what was tried."""


class StoreError(UserError, OSError):
    """Error of a file that cannot be written, or that is no cube.

    Examples
    --------
    >>> import dimersweep
    >>> try:
    ...     dimersweep.open_cube("absent.nc")
    ... except dimersweep.StoreError as error:
    ...     print(error)
    absent.nc: no such file
    """


class PointError(UserError, RuntimeError):
    """Error of a point that failed, where the user asked to stop at the first failure.

    Examples
    --------
    >>> from dimersweep import sweep
    >>> from dimersweep.errors import PointError
    >>> try:
    ...     cube = sweep({"Gamma": [0.6, 0.9]}, periods=60, progress=False, fail_fast=True)
    ... except PointError as error:
    ...     print(error)
    ... else:
    ...     print("no point failed")
    no point failed
    """


class UnfinishedError(UserError, RuntimeError):
    """Error of a sweep that lacks points, which the machine or the program could not run: they are still to be done."""


class KernelError(UserError, RuntimeError):
    """Error of a kernel that cannot run here, computes other numbers than it must, or does not finish a motion."""


class Stopped(KeyboardInterrupt):
    """Interrupt of a sweep by Ctrl-C or SIGTERM; the message says which results are kept and how to go on.

    Parameters
    ----------
    message : str
    signal : int
        Number of the signal.

    Examples
    --------
    >>> from dimersweep import sweep
    >>> from dimersweep.errors import Stopped
    >>> try:
    ...     cube = sweep({"Gamma": [0.6, 0.9]}, periods=60, progress=False)
    ... except Stopped as error:
    ...     print(error)
    ... else:
    ...     print("not stopped")
    not stopped
    """

    def __init__(self, message: str, signal: int) -> None:
        super().__init__(message)
        self.signal = signal


def unknown(name: str, kind: str, allowed: Iterable[str], rest: str = "") -> str:
    """Return the message about a `name` that is none of `allowed`, with the allowed names near to it.

    `kind` says what is named. The message ends with all allowed names, or with `rest` in place of a long list.
    """
    from difflib import get_close_matches

    # capitals and small letters are alike, and so are numbers with and without leading zeros
    def plain(text: str) -> str:
        return re.sub(r"0+(?=\d)", "", text.lower())

    allowed = list(allowed)
    # the dashes of options would make all of them similar
    words, word = {each.lstrip("-"): each for each in allowed}, str(name).lstrip("-")
    same = [each for each in words if plain(each) == plain(word)]
    near = same or get_close_matches(word, words, 3 if rest else 1)
    meant = f"; did you mean {' or '.join(words[each] for each in near)}?" if near else ""
    return f"{one_line(name)}: unknown {kind}{meant} ({rest or 'allowed: ' + ', '.join(allowed)})"


def one_line(error: object) -> str:
    """Return the text of another library's error, or a name from a user, on one line of at most 200 characters."""
    return " ".join(str(error).split())[:200]

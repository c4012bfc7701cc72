"""Errors that are the user's to mend: each message is one line with the name, the value and what is allowed."""

import re
from collections.abc import Iterable


class UserError(Exception):
    """Something given to the program that it cannot work with."""


class ParameterError(UserError, ValueError):
    """A parameter, an axis or a setting that the model does not allow.

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
    """What was asked of something that a run does not have: with what it has instead."""


class OrbitError(UserError, RuntimeError):
    """An orbit, a branch or a border that was not found: with what was tried."""


class StoreError(UserError, OSError):
    """A file that cannot be written, or that is no cube.

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
    """A point that failed, where the user asked to stop at the first one.

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
    """A sweep that lacks points, which the machine or the program could not run: they are still to be done."""


class KernelError(UserError, RuntimeError):
    """A kernel that cannot run here, that gives other numbers than it must, or that does not get through a motion."""


class Stopped(KeyboardInterrupt):
    """A sweep that Ctrl-C or a SIGTERM has stopped: the message says what is kept and how to go on.

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
    """What to say of a `name` that is none of `allowed`: which it is near to, and all of them, or where to find the `rest`."""
    from difflib import get_close_matches

    def plain(text: str) -> str:  # capitals, and zeros before a number, are alike
        return re.sub(r"0+(?=\d)", "", text.lower())

    allowed = list(allowed)
    words, word = {each.lstrip("-"): each for each in allowed}, str(name).lstrip("-")  # the dashes of options are alike
    same = [each for each in words if plain(each) == plain(word)]
    near = same or get_close_matches(word, words, 3 if rest else 1)
    meant = f"; did you mean {' or '.join(words[each] for each in near)}?" if near else ""
    return f"{one_line(name)}: unknown {kind}{meant} ({rest or 'allowed: ' + ', '.join(allowed)})"


def one_line(error: object) -> str:
    """What an error of another library says, or a name of a user's, on one line that is not too long."""
    return " ".join(str(error).split())[:200]

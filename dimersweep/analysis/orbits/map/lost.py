"""Orbits that are lost: one error, and what is done without an orbit.

All that is built on the return map fails in one way. Where the kernel cannot go on, where Newton's method does not
converge, or where the orbit found is not the one that was meant, `OrbitLost` is raised, mostly by `require`. Functions do
not say so each. It is caught where a step is taken: the step is shortened, or begun in another way.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from dimersweep.errors import OrbitError

T = TypeVar("T")


class OrbitLost(OrbitError):
    """The error of a map or an orbit that does not exist here, or is not found; its one line says why."""


def require(holds: Any, why: str) -> None:
    """Raise OrbitLost with a reason unless a condition holds."""
    if not holds:
        raise OrbitLost(why)


@contextmanager
def singular_lost() -> Iterator[None]:
    """Let an orbit be lost at a matrix without an inverse or eigenvectors; a context, and a decorator of functions."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise OrbitLost(f"the derivatives there are of no use ({error})") from error


def attempt(way: Callable[..., T], *given: Any) -> T | None:
    """Return the result of a way to an orbit, or None where it is lost."""
    return next(all_found([lambda: way(*given)]), None)


def all_found(ways: Iterable[Callable[[], T]]) -> Iterator[T]:
    """Yield the results of all ways that succeed."""
    for way in ways:
        try:
            found = way()
        except OrbitLost:
            continue
        yield found


def first_found(ways: Iterable[Callable[[], T]], why: str = "") -> T:
    """Return the result of the first way that succeeds.

    If all fail, an orbit is lost: for the reason `why` or, by default, with the error of the last way.
    """
    reason: OrbitError = OrbitLost("there is nothing to begin with")
    for way in ways:
        try:
            return way()
        except OrbitError as error:
            reason = error
    require(not why, why)
    raise reason


def in_steps(step: Callable[[T, float], T], begin: T, least: float) -> T:
    """Go the whole way from `begin` in one step, or in several shorter ones, and return the result of the last one.

    ``step(here, to)`` goes on from a result to the share `to` of the way, which is 1 at the end. Two halves replace a
    step on which the orbit is lost, and so on, down to a share of `least`.
    """
    here, done, length = begin, 0.0, 1.0
    while done < 1.0:
        try:
            here, done = step(here, done + length), done + length
        except OrbitLost:
            length *= 0.5
            if length < least:
                raise
        else:
            while done % (2 * length) == 0.0:  # both halves are done, and what comes next is as long as both
                length *= 2
    return here

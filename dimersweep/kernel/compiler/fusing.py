"""Rewrite sums of products as `fma`, so that the sources alone decide where a product is not rounded.

`fma(a, b, c)` is a * b + c, rounded once. If a compiler may fuse a product and a sum by itself, the result depends on
its optimiser, its version and its processor. So it may not, and the sums are written as `fma` before anything is
compiled. Where a function is compiled with ``fuse``, each sum or difference of two terms, of which at least one is a
product, becomes an `fma`. It fuses the first of the terms that is a product.

    a*b + c*d  is  fma(a, b, c*d)      a*b - c  is  fma(a, b, -c)      c += a*b  is  c = fma(a, b, c)
    c + a*b    is  fma(a, b, c)        c - a*b  is  fma(-a, b, c)      a*b + c*d + e*f  is  fma(e, f, fma(a, b, c*d))

A product of more than two factors has two here: the rounded product of all but the last, and the last. A power, a
quotient, -(a*b) and a variable that holds a product are no products here. Indices of arrays are left as they are. Other
sums of products of integers must not stand in such a function.
"""

import ast
import copy
import ctypes
import functools
import inspect
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

from numba import types
from numba.extending import lower_builtin, type_callable

NAME = "a * b + c, rounded once"  # name of `fma` in a rewritten function, which no variable of the sources can have
_of_the_library = ctypes.CDLL(None).fma  # from the C library that Python is linked with, exact on any processor
_of_the_library.argtypes, _of_the_library.restype = [ctypes.c_double] * 3, ctypes.c_double


def fma(a: Any, b: Any, c: Any) -> float:
    """Return a * b + c, rounded once."""
    return _of_the_library(a, b, c)


@type_callable(fma)
def _type_of_fma(_: Any) -> Callable[..., Any]:
    def kind(a: Any, b: Any, c: Any) -> Any:
        # integers are refused: an index or a count would become a float
        whole = all(isinstance(each, types.Integer) for each in (a, b, c))
        return None if whole else types.float64(types.float64, types.float64, types.float64)

    return kind


@lower_builtin(fma, types.float64, types.float64, types.float64)
def _code_of_fma(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    return builder.fma(*given)


def _minus(term: ast.expr) -> ast.expr:
    return ast.UnaryOp(ast.USub(), term)


def _factors(term: ast.expr) -> list[ast.expr]:
    """Return the two factors of a product, or an empty list if a term is no product."""
    if isinstance(term, ast.BinOp) and isinstance(term.op, ast.Mult):
        return [term.left, term.right]
    return []


class Fusing(ast.NodeTransformer):
    """A transformer of syntax trees that writes sums of products as `fma`."""

    def fused(self, *terms: ast.expr) -> ast.expr:
        return ast.Call(ast.Name(NAME, ast.Load()), [*terms], [])

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Add | ast.Sub):
            return node
        left, right = node.left, node.right
        if isinstance(node.op, ast.Sub):  # the minus goes into the first factor of a product, or before another term
            right = ast.BinOp(_minus(at[0]), ast.Mult(), at[1]) if (at := _factors(right)) else _minus(right)
        first, other = (left, right) if _factors(left) else (right, left)
        factors = _factors(first)
        return ast.copy_location(self.fused(*factors, other), node) if factors else node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt:
        before = copy.copy(node.target)
        before.ctx = ast.Load()  # the target, as it is read on the right side
        after = ast.copy_location(ast.BinOp(before, node.op, node.value), node)
        return ast.copy_location(ast.Assign([node.target], self.visit(after)), node)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        node.value = self.visit(node.value)
        return node


def fused(function: Any, lines: Sequence[str]) -> Callable[..., Any]:
    """Return a function with its sums of products written as `fma`; `lines` are the lines of its file."""
    first = function.__code__.co_firstlineno - 1
    module = ast.parse(textwrap.dedent("".join(inspect.getblock(lines[first:]))))
    definition: Any = module.body[0]
    definition.decorator_list = []
    ast.increment_lineno(ast.fix_missing_locations(Fusing().visit(module)), first)
    function.__globals__.setdefault(NAME, fma)
    found: dict[str, Any] = {}
    exec(compile(module, function.__code__.co_filename, "exec"), function.__globals__, found)
    return functools.update_wrapper(found[function.__name__], function)

"""One arithmetic: which products of sums are not rounded, written out before anything is compiled.

`fma(a, b, c)` is a * b + c, rounded once. A compiler that may fuse on its own does so as its optimiser, its version and its
processor have it. Here the sources alone decide. Where a function is compiled with ``fuse``, each sum or difference of two
terms, of which at least one is a product, is an `fma`: of the first of the two that is a product.

    a*b + c*d  is  fma(a, b, c*d)      a*b - c  is  fma(a, b, -c)      c += a*b  is  c = fma(a, b, c)
    c + a*b    is  fma(a, b, c)        c - a*b  is  fma(-a, b, c)      a*b + c*d + e*f  is  fma(e, f, fma(a, b, c*d))

Of more factors the last one is multiplied by the others' rounded product. A power, a quotient and a product that has a name
are no products here, and whole numbers that are places in an array are left as they are.
"""

import ast
import copy
import functools
import inspect
import textwrap
from collections.abc import Callable, Sequence
from math import fsum, inf, isfinite
from numbers import Integral
from typing import Any

from numba import types
from numba.extending import lower_builtin, type_callable

SPLIT = 2.0**27 + 1.0  # leaves 26 digits of 53
SMALL, LARGE = 1e-280, 1e280  # of a product, between which none of its parts is too small or too large
NAME = "a * b + c, rounded once"  # of `fma` in a rewritten function: no name that sources can have


def fma(a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once; of whole numbers a whole one."""
    if not isinstance(a, float) and all(isinstance(each, Integral) for each in (a, b, c)):
        return a * b + c
    a, b, c = float(a), float(b), float(c)
    product = a * b
    if SMALL < abs(product) < LARGE and abs(a) < LARGE and abs(b) < LARGE:
        first, second = SPLIT * a, SPLIT * b
        first, second = first - (first - a), second - (second - b)  # the upper halves of their digits
        rest, other = a - first, b - second
        # Dekker's product (doi 10.1007/BF01397083) has no error, and fsum rounds once
        return fsum((product, rest * other - (((product - first * second) - rest * second) - first * other), c))
    if not (isfinite(a) and isfinite(b)):
        return a * b + c
    if not isfinite(c):  # where a product is infinite by rounding alone
        return c
    (p, s), (q, t), (r, u) = a.as_integer_ratio(), b.as_integer_ratio(), c.as_integer_ratio()
    exact = p * q * u + r * s * t
    if exact == 0:  # the sign of a sum of zeros, or of two numbers that cancel
        return float(a * b + c) if p * q == 0 else 0.0
    try:
        return exact / (s * t * u)  # Python rounds a quotient of whole numbers once
    except OverflowError:
        return inf if exact > 0 else -inf


@type_callable(fma)
def _type_of_fma(_: Any) -> Callable[..., Any]:
    def kind(a: Any, b: Any, c: Any) -> Any:
        number = types.int64 if all(isinstance(each, types.Integer) for each in (a, b, c)) else types.float64
        return number(number, number, number)

    return kind


@lower_builtin(fma, types.VarArg(types.Any))
def _code_of_fma(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    if signature.return_type == types.float64:
        return builder.fma(*given)
    return builder.add(builder.mul(given[0], given[1]), given[2])


def _minus(term: ast.expr) -> ast.expr:
    return ast.UnaryOp(ast.USub(), term)


def _factors(term: ast.expr) -> list[ast.expr]:
    """The two factors of a product, or none."""
    if isinstance(term, ast.BinOp) and isinstance(term.op, ast.Mult):
        return [term.left, term.right]
    if isinstance(term, ast.UnaryOp) and isinstance(term.op, ast.USub) and (factors := _factors(term.operand)):
        return [_minus(factors[0]), factors[1]]
    return []


class Fusing(ast.NodeTransformer):
    """Writes `fma` for the sums of products of a function."""

    def fused(self, *terms: ast.expr) -> ast.expr:
        return ast.Call(ast.Name(NAME, ast.Load()), [*terms], [])

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Add | ast.Sub):
            return node
        left, right = node.left, node.right
        if isinstance(node.op, ast.Sub):  # the minus goes into the factor, or the last term
            right = ast.BinOp(_minus(at[0]), ast.Mult(), at[1]) if (at := _factors(right)) else _minus(right)
        first, other = (left, right) if _factors(left) else (right, left)
        factors = _factors(first)
        return ast.copy_location(self.fused(*factors, other), node) if factors else node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.stmt:
        before = copy.copy(node.target)
        before.ctx = ast.Load()  # what is read where the target is written
        found = self.visit_BinOp(ast.copy_location(ast.BinOp(before, node.op, node.value), node))
        if isinstance(found, ast.BinOp):
            return ast.copy_location(ast.AugAssign(node.target, node.op, found.right), node)
        return ast.copy_location(ast.Assign([node.target], found), node)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        node.value = self.visit(node.value)
        return node


def fused(function: Callable[..., Any], lines: Sequence[str]) -> Callable[..., Any]:
    """Return this function with its sums of products written out as `fma`; `lines` are those of its file."""
    was: Any = function
    first = was.__code__.co_firstlineno - 1
    module = ast.parse(textwrap.dedent("".join(inspect.getblock(lines[first:]))))
    definition: Any = module.body[0]
    definition.decorator_list = []
    ast.increment_lineno(ast.fix_missing_locations(Fusing().visit(module)), first)
    around = inspect.getclosurevars(was).nonlocals  # names of a function around it
    scope = was.__globals__ | around if around else was.__globals__
    scope.setdefault(NAME, fma)
    found: dict[str, Any] = {}
    exec(compile(module, was.__code__.co_filename, "exec"), scope, found)
    return functools.update_wrapper(found[was.__name__], was)

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
import inspect
import textwrap
from collections.abc import Callable, Sequence
from math import inf, isfinite
from numbers import Integral
from types import CodeType, FunctionType
from typing import Any

from numba import types
from numba.extending import lower_builtin, type_callable

NAME = "a * b + c, rounded once"  # of `fma` in a rewritten function: no name that sources can have


def fma(a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once; of whole numbers a whole one."""
    if all(isinstance(each, Integral) for each in (a, b, c)):
        return a * b + c
    a, b, c = float(a), float(b), float(c)
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
        whole = all(isinstance(each, types.Integer) for each in (a, b, c))
        number = types.int64 if whole else types.float64
        return number(number, number, number)

    return kind


@lower_builtin(fma, types.float64, types.float64, types.float64)
def _fma_of_floats(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    return builder.fma(*given)


@lower_builtin(fma, types.int64, types.int64, types.int64)
def _fma_of_whole_numbers(_: Any, builder: Any, signature: Any, given: Any) -> Any:
    return builder.add(builder.mul(given[0], given[1]), given[2])


def _minus(term: ast.expr) -> ast.expr:
    return ast.UnaryOp(ast.USub(), term)


def _factors(term: ast.expr) -> tuple[ast.expr, ast.expr] | None:
    """The two factors of a product, or None."""
    match term:
        case ast.BinOp(left, ast.Mult(), right):
            return left, right
        case ast.UnaryOp(ast.USub(), ast.BinOp(left, ast.Mult(), right)):
            return _minus(left), right
    return None


class Fusing(ast.NodeTransformer):
    """Writes `fma` for the sums of products of a function."""

    def fused(self, a: ast.expr, b: ast.expr, c: ast.expr) -> ast.expr:
        return ast.Call(ast.Name(NAME, ast.Load()), [a, b, c], [])

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Add | ast.Sub):
            return node
        left, right = node.left, node.right
        negative = isinstance(node.op, ast.Sub)
        if factors := _factors(left):
            call = self.fused(*factors, _minus(right) if negative else right)
        elif factors := _factors(right):
            call = self.fused(_minus(factors[0]) if negative else factors[0], factors[1], left)
        else:
            return node
        return ast.copy_location(call, node)

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


def _code_of(tree: Any, name: str) -> CodeType:
    """The code of a function in what was compiled."""
    inner = [each for each in tree.co_consts if isinstance(each, CodeType)]
    return next((each for each in inner if each.co_name == name), None) or _code_of(inner[0], name)


def fused(function: Callable[..., Any], lines: Sequence[str]) -> Callable[..., Any]:
    """Return this function with its sums of products written out as `fma`; `lines` are those of its file."""
    was: Any = function
    first = was.__code__.co_firstlineno
    module = ast.parse(textwrap.dedent("".join(inspect.getblock(lines[first - 1 :]))))
    ast.increment_lineno(module, first - 1)
    definition: Any = module.body[0]
    definition.decorator_list = []
    Fusing().visit(definition)
    if was.__code__.co_freevars:  # names of the function around it
        around: Any = ast.parse(f"def around({', '.join(was.__code__.co_freevars)}): pass")
        around.body[0].body = module.body
        module = around
    code = _code_of(compile(ast.fix_missing_locations(module), was.__code__.co_filename, "exec"), was.__name__)
    was.__globals__.setdefault(NAME, fma)
    written = FunctionType(code, was.__globals__, was.__name__, was.__defaults__, was.__closure__)
    written.__qualname__, written.__doc__, written.__module__ = was.__qualname__, was.__doc__, was.__module__
    written.__kwdefaults__, written.__annotations__ = was.__kwdefaults__, was.__annotations__
    return written

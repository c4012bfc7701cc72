"""Numba's compiler without what a kernel has no need of, which takes two fifths of the time to compile.

Kernels have no closures, no ``with``, no mixed tuples indexed by constants and nothing to count references of (so it does not
matter when a variable dies). What they have is the same few operations on the same few types a thousand times, most of all
numbers read from and written to contiguous arrays.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import Any

from numba.core import base, errors, event, interpreter, lowering, typeinfer, types
from numba.core.compiler import CompilerBase, PassManager
from numba.core.compiler_machinery import register_pass
from numba.core.ir_utils import build_definitions
from numba.core.lowering import Lower
from numba.core.ssa import reconstruct_ssa
from numba.core.typed_passes import NativeLowering, NoPythonBackend, NopythonTypeInference, PreLowerStripPhis
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext
from numba.core.untyped_passes import FixupArgs, ReconstructSSA, TranslateByteCode
from numba.np.arrayobj import load_item, store_item

from dimersweep.kernel.compiler.linking import Part, kernel_codegen, refusal

_types: Any = types
_Base: Any = CompilerBase
_Function: Any = BaseFunction
_Context: Any = BaseContext
_errors: Any = errors
_base: Any = base
_Manager: Any = PassManager
_Lower: Any = Lower
_Lowering: Any = NativeLowering
_SSA: Any = ReconstructSSA
_StripPhis: Any = PreLowerStripPhis
_type: Callable[..., Any] = _Function.get_call_type
_attribute: Callable[..., Any] = _Context.resolve_getattr
_typed: dict[Any, Any] = {}
_sizes: dict[Any, int] = {}
_NOTHING = nullcontext()


class _KernelLower(_Lower):
    """Numba's writer of LLVM code, terse about a number in a contiguous array: Numba unpacks the whole array for each."""

    def _place(self, array: Any, index: Any, signature: Any) -> Any:
        """Pointer to the number at an index, of which any part may be negative; None if it is not a number that is meant."""
        builder, context = self.builder, self.context
        kind, at = signature.args[:2]
        axes = tuple(at) if isinstance(at, _types.BaseTuple) else (at,)
        contiguous = isinstance(kind, _types.Array) and kind.layout == "C" and kind.ndim == len(axes)
        whole = all(isinstance(axis, _types.Integer) and axis.signed for axis in axes)
        if not (contiguous and whole) or context.enable_boundscheck:
            return None
        field = context.data_model_manager[kind].get_field_position
        data, indices = self.loadvar(array.name), self._cast_var(index, at)
        place = None
        for n, axis in enumerate(axes):
            i = builder.extract_value(indices, n) if isinstance(at, _types.BaseTuple) else indices
            i = context.cast(builder, i, axis, _types.intp)
            length = builder.extract_value(data, [field("shape"), n])
            i = builder.select(builder.icmp_signed("<", i, i.type(0)), builder.add(i, length), i)
            place = i if place is None else builder.add(builder.mul(place, length), i)
        return builder.gep(builder.extract_value(data, field("data")), [place])

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        place = self._place(value, index, signature)
        if place is None:
            return super().lower_getitem(resty, expr, value, index, signature)
        number = load_item(self.context, self.builder, signature.args[0], place)
        return self.context.cast(self.builder, number, signature.return_type, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        place = self._place(target_var, index_var, signature)
        if place is None:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        array = signature.args[0]
        return store_item(self.context, self.builder, array, self._cast_var(value_var, array.dtype), place)


@register_pass(mutates_CFG=False, analysis_only=False)
class _KernelSSA(_SSA):
    """Numba's single assignment form, without the lifetimes of variables: only reference counts need them."""

    _name = "kernel_ssa"

    def run_pass(self, state: Any) -> bool:
        state.func_ir = reconstruct_ssa(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class _KernelStripPhis(_StripPhis):
    """Numba's pass that takes the phi nodes out again, without the lifetimes."""

    _name = "kernel_strip_phis"

    def run_pass(self, state: Any) -> bool:
        state.func_ir = self._strip_phi_nodes(state.func_ir)
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class _KernelLowering(_Lowering):
    _name = "kernel_lowering"

    @property
    def lowering_class(self) -> Any:
        return _KernelLower


class _Passes(_Manager):
    """Numba's sequence of passes, without its checks and events."""

    def _runPass(self, index: int, each: Any, state: Any) -> None:
        each.analysis = self._analysis
        each.run_initialization(state)
        each.run_pass(state)
        each.run_finalizer(state)


_PASSES = (
    TranslateByteCode,
    FixupArgs,
    _KernelSSA,
    NopythonTypeInference,
    _KernelStripPhis,
    _KernelLowering,
    NoPythonBackend,
)


def _type_once(function: Any, context: Any, args: Any, kws: Any) -> Any:
    """Signature of a built-in function or operator for types of arguments: Numba looks through all it knows every time."""
    key = function, context, tuple(args), tuple(kws.items())
    if key not in _typed:
        _typed[key] = _type(function, context, args, kws)
    return _typed[key]


def _attribute_once(context: Any, kind: Any, name: str) -> Any:
    """Type of an attribute of a type, likewise."""
    key = context, kind, name
    if key not in _typed:
        _typed[key] = _attribute(context, kind, name)
    return _typed[key]


class _ErrorContext:
    """Says of an error what was compiled, as Numba's own context manager does, which takes three times as long."""

    def __init__(self, message: str, *args: Any, **kwargs: Any) -> None:
        self.said = message, args, kwargs

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, errors.NumbaError):
            error.add_context(_errors._format_msg(*self.said))


def _as_it_is(code: Any) -> Any:
    return code


_HURRIED: tuple[tuple[Any, str, Any], ...] = (
    (_Function, "get_call_type", _type_once),
    (_Context, "resolve_getattr", _attribute_once),
    (typeinfer, "new_error_context", _ErrorContext),
    (lowering, "new_error_context", _ErrorContext),
    # a filter of warnings is set for each assignment, and each call of LLVM is announced to all compilations that are under way
    (_errors.WarningsFixer, "catch_warnings", lambda *_, **__: _NOTHING),
    (event, "broadcast", lambda _: None),
    # whether the writer of an operation takes a place in the source is read from its signature each time
    (base, "_has_loc", cache(_base._has_loc)),
    # kernels have no ``with`` and no dictionaries to look for
    (interpreter, "peep_hole_delete_with_exit", _as_it_is),
    (interpreter, "peep_hole_fuse_dict_add_updates", _as_it_is),
)


@contextmanager
def _in_a_hurry() -> Iterator[None]:
    """Type every operation once, watch nothing, and look for no garbage; Numba's lock keeps other threads from compiling."""
    before, collects = [getattr(owner, name) for owner, name, _ in _HURRIED], gc.isenabled()
    try:
        for owner, name, quick in _HURRIED:
            setattr(owner, name, quick)
        gc.disable()  # looking for cycles among millions of objects takes a seventh of the time
        yield
    finally:
        for (owner, name, _), former in zip(_HURRIED, before, strict=True):
            setattr(owner, name, former)
        if collects:
            gc.enable()


class KernelCompiler(_Base):
    """Numba's compiler with the passes that a kernel needs."""

    def define_pipelines(self) -> list[Any]:
        passes = _Passes("kernel")
        for each in _PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]

    def compile_extra(self, func: Any) -> Any:
        context = self.state.targetctx  # a copy for this function only
        context._internal_codegen = kernel_codegen()
        size = context.get_abi_sizeof  # asks LLVM each time
        context.get_abi_sizeof = lambda kind: _sizes.get(kind) or _sizes.setdefault(kind, size(kind))
        with _in_a_hurry():
            return super().compile_extra(func)


class _PartCompiler(KernelCompiler):
    """Compiles a function that only other kernels call: it becomes a part, not machine code."""

    def compile_extra(self, func: Any) -> Any:
        state = self.state
        state.library = Part(kernel_codegen(), func.__qualname__)
        state.targetctx.get_executable = refusal
        return super().compile_extra(func)


def fast_settings(part: bool) -> dict[str, Any]:
    """Further settings of ``numba.njit`` for a kernel that Python calls, or a part that only other kernels call."""
    return {"pipeline_class": _PartCompiler, "no_cpython_wrapper": True} if part else {"pipeline_class": KernelCompiler}

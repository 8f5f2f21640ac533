"""SIMD vectors for Numba:  `WIDTH` doubles in one value, one lane per loop.

LLVM does not vectorise loops over many arrays that might overlap; with operations on its vector type it need not prove
that they do not.  There is no contraction and no reassociation: each lane has the bits of the scalar operation.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from fopi_tune.simulation.sampled.layout import WIDTH

_DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
_BITS = ir.VectorType(ir.IntType(1), WIDTH)
_INTEGERS = ir.VectorType(ir.IntType(64), WIDTH)


#: an intrinsic returns its signature and code generator; callers see the generated function, hence the cast
_instruction = cast("Callable[[Any], Any]", intrinsic)


class Vector(types.Type):
    """The type of WIDTH doubles."""

    def __init__(self) -> None:
        super().__init__(f"Vector{WIDTH}")


class Mask(types.Type):
    """The type of WIDTH truth values."""

    def __init__(self) -> None:
        super().__init__(f"Mask{WIDTH}")


class Words(types.Type):
    """The type of WIDTH unsigned words of 64 bits."""

    def __init__(self) -> None:
        super().__init__(f"Words{WIDTH}")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


@register_model(Words)
class _WordsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _INTEGERS)


_VECTOR, _MASK, _WORDS = Vector(), Mask(), Words()


@_instruction
def pointer(_typing: Any, array: Any) -> Any:
    """Pointer to the data of a contiguous array: indexed like it, without bounds checks and reference counting.

    Reference counts are atomic operations, which took three quarters of the time.  The caller keeps the array alive.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_array(sig.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


@_instruction
def offset_pointer(_typing: Any, base: Any, place: Any) -> Any:
    """The pointer moved by `place` elements."""
    return base(base, types.intp), lambda _context, builder, _sig, args: builder.gep(args[0], [args[1]])


def _address(builder: Any, args: Any) -> Any:
    return builder.bitcast(builder.gep(args[0], [args[1]]), _DOUBLES.as_pointer())


@_instruction
def load(_typing: Any, base: Any, place: Any) -> Any:
    """The vector of the doubles from pointer + place on."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.load(_address(builder, args), align=8)

    return _VECTOR(base, types.intp), generate


@_instruction
def store(_typing: Any, base: Any, place: Any, vector: Any) -> Any:
    """Write a vector from pointer + place on."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        builder.store(args[2], _address(builder, args), align=8)
        return context.get_dummy_value()

    return types.void(base, types.intp, vector), generate


def _broadcast(builder: Any, kind: Any, value: Any) -> Any:
    index = ir.IntType(32)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(index, 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(index, WIDTH), [0] * WIDTH))


@_instruction
def broadcast(_typing: Any, value: Any) -> Any:
    """A number in every lane."""
    return _VECTOR(types.float64), lambda _context, builder, _sig, args: _broadcast(builder, _DOUBLES, args[0])


@_instruction
def word_sequence(_typing: Any, first: Any, step: Any) -> Any:
    """The words first, first + step, first + 2 step, ..., one per lane."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        base, step = (_broadcast(builder, _INTEGERS, number) for number in args)
        return builder.add(base, builder.mul(step, ir.Constant(_INTEGERS, list(range(WIDTH)))))

    return _WORDS(types.uint64, types.uint64), generate


@_instruction
def half_product(_typing: Any, vector: Any, factor: Any) -> Any:
    """Lane by lane the product, 64 bits, of the lower 32 bits and a factor below 2^32."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        mask = ir.Constant(_INTEGERS, [2**32 - 1] * WIDTH)
        # that both factors are below 2^32 makes this one instruction
        one, two = (builder.and_(word, mask) for word in (args[0], _broadcast(builder, _INTEGERS, args[1])))
        return builder.mul(one, two)

    return _WORDS(_WORDS, types.uint64), generate


@_instruction
def upper_half(_typing: Any, vector: Any) -> Any:
    """Lane by lane the upper 32 bits."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.lshr(args[0], ir.Constant(_INTEGERS, [32] * WIDTH))

    return _WORDS(_WORDS), generate


@_instruction
def upper_bits(_typing: Any, upper: Any, lower: Any) -> Any:
    """The upper 52 bits, as a number, of the lower halves of two words side by side."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        half, mask, right = (ir.Constant(_INTEGERS, [number] * WIDTH) for number in (20, 2**32 - 1, 12))
        upper, lower = (builder.and_(word, mask) for word in args)
        # a number below 2^63 has the same value with a sign
        return builder.sitofp(builder.or_(builder.shl(upper, half), builder.lshr(lower, right)), _DOUBLES)

    return _VECTOR(_WORDS, _WORDS), generate


#: the bits of 1, and of the lowest mantissa, next to sqrt(1/2)
_ONE, _LOWEST = 0x3FF0000000000000, 0x3FE6A09E00000000


@_instruction
def exponent_and_mantissa(_typing: Any, vector: Any) -> Any:
    """Lane by lane k and m of a positive number m 2^k that is not subnormal, sqrt(1/2) <= m < sqrt(2), about."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        shift, bias, one, lowest, fraction = (
            ir.Constant(_INTEGERS, [number] * WIDTH) for number in (52, 1023, _ONE - _LOWEST, _LOWEST, 2**52 - 1)
        )
        moved = builder.add(builder.bitcast(args[0], _INTEGERS), one)
        exponent = builder.sitofp(builder.sub(builder.lshr(moved, shift), bias), _DOUBLES)
        mantissa = builder.bitcast(builder.add(builder.and_(moved, fraction), lowest), _DOUBLES)
        return context.make_tuple(builder, sig.return_type, (exponent, mantissa))

    return types.UniTuple(_VECTOR, 2)(_VECTOR), generate


@_instruction
def compress_store(_typing: Any, base: Any, place: Any, vector: Any, mask: Any) -> Any:
    """Write the lanes of a mask without gaps from pointer + place on."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [_DOUBLES, ir.DoubleType().as_pointer(), _BITS])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.compressstore.v{WIDTH}f64")
        builder.call(function, [args[2], builder.gep(args[0], [args[1]]), args[3]])
        return context.get_dummy_value()

    return types.void(base, types.intp, _VECTOR, _MASK), generate


@_instruction
def expand_load(_typing: Any, base: Any, place: Any, mask: Any, others: Any) -> Any:
    """Read what `compress_store` wrote into the lanes of the mask; `others` elsewhere."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_DOUBLES, [ir.DoubleType().as_pointer(), _BITS, _DOUBLES])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.expandload.v{WIDTH}f64")
        return builder.call(function, [builder.gep(args[0], [args[1]]), args[2], args[3]])

    return _VECTOR(base, types.intp, _MASK, _VECTOR), generate


@_instruction
def count_bits(_typing: Any, word: Any) -> Any:
    """How many bits are set."""
    return types.int64(types.int64), lambda _context, builder, _sig, args: builder.ctpop(args[0])


@_instruction
def where(_typing: Any, mask: Any, yes: Any, no: Any) -> Any:
    """Lane by lane `yes` where the mask is set and `no` where it is not."""
    return _VECTOR(_MASK, _VECTOR, _VECTOR), lambda _context, builder, _sig, args: builder.select(*args)


@_instruction
def bits(_typing: Any, mask: Any) -> Any:
    """The mask as a whole number, lane 0 in the lowest bit."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(WIDTH)), ir.IntType(64))

    return types.int64(_MASK), generate


@_instruction
def without(_typing: Any, mask: Any, other: Any) -> Any:
    """The lanes of a mask that are not in the other."""
    return _MASK(_MASK, _MASK), lambda _context, builder, _sig, args: builder.and_(args[0], builder.not_(args[1]))


@_instruction
def mask_from_bits(_typing: Any, word: Any) -> Any:
    """The mask of a whole number."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.bitcast(builder.trunc(args[0], ir.IntType(WIDTH)), _BITS)

    return _MASK(types.int64), generate


def _by_llvm(name: str) -> Callable[..., Any]:
    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64"), args)

    return generate


@_instruction
def absolute(_typing: Any, vector: Any) -> Any:
    """Lane by lane the absolute value."""
    return _VECTOR(_VECTOR), _by_llvm("fabs")


@_instruction
def rounded(_typing: Any, vector: Any) -> Any:
    """Lane by lane the nearest whole number, halves to the even one."""
    return _VECTOR(_VECTOR), _by_llvm("rint")


@_instruction
def square_root(_typing: Any, vector: Any) -> Any:
    """Lane by lane the square root."""
    return _VECTOR(_VECTOR), _by_llvm("sqrt")


def _operator(function: Any, operand: Any, result: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    infer: Any = infer_global

    @infer(function)
    class _Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            return signature(result, operand, operand) if args == (operand, operand) and not kws else None

    lower_builtin(function, type(operand), type(operand))(lambda _context, builder, _sig, args: emit(builder, *args))


_operator(operator.add, _VECTOR, _VECTOR, lambda builder, x, y: builder.fadd(x, y))
_operator(operator.sub, _VECTOR, _VECTOR, lambda builder, x, y: builder.fsub(x, y))
_operator(operator.mul, _VECTOR, _VECTOR, lambda builder, x, y: builder.fmul(x, y))
_operator(operator.truediv, _VECTOR, _VECTOR, lambda builder, x, y: builder.fdiv(x, y))
_operator(operator.lt, _VECTOR, _MASK, lambda builder, x, y: builder.fcmp_ordered("<", x, y))
_operator(operator.le, _VECTOR, _MASK, lambda builder, x, y: builder.fcmp_ordered("<=", x, y))
_operator(operator.gt, _VECTOR, _MASK, lambda builder, x, y: builder.fcmp_ordered(">", x, y))
_operator(operator.ge, _VECTOR, _MASK, lambda builder, x, y: builder.fcmp_ordered(">=", x, y))
_operator(operator.ne, _VECTOR, _MASK, lambda builder, x, y: builder.fcmp_unordered("!=", x, y))
_operator(operator.and_, _MASK, _MASK, lambda builder, x, y: builder.and_(x, y))
_operator(operator.or_, _MASK, _MASK, lambda builder, x, y: builder.or_(x, y))
_operator(operator.add, _WORDS, _WORDS, lambda builder, x, y: builder.add(x, y))
_operator(operator.xor, _WORDS, _WORDS, lambda builder, x, y: builder.xor(x, y))

"""Vectors for Numba:  `WIDTH` loops side by side in one value, each computed as it would be alone.

LLVM gives up on vectorising loops over many arrays that might overlap; operations on its vector type need no proof of
that.  There is no contraction and no reassociation: a lane's result has no other bits than the scalar operation's.
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


#: Numba fills in a function by the signature and the generator it returns; its users call what is filled in
_instruction = cast("Callable[[Any], Any]", intrinsic)


class Vector(types.Type):
    """The type of WIDTH doubles."""

    def __init__(self) -> None:
        super().__init__(f"Pack{WIDTH}")


class Mask(types.Type):
    """The type of WIDTH truth values."""

    def __init__(self) -> None:
        super().__init__(f"Mask{WIDTH}")


class Words(types.Type):
    """The type of WIDTH unsigned words of 64 bits."""

    def __init__(self) -> None:
        super().__init__(f"Words{WIDTH}")


@register_model(Vector)
class _PackModel(models.PrimitiveModel):
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


_PACK, _MASK, _WORDS = Vector(), Mask(), Words()


@_instruction
def pointer(_typing: Any, array: Any) -> Any:
    """Where a contiguous array's numbers are: indexed like it, unchecked, and not counted as a reference to it.

    Reference counts are atomic operations, and they were three quarters of the time.  The array has to live on.
    """

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_array(sig.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


@_instruction
def offset_pointer(_typing: Any, begin: Any, place: Any) -> Any:
    """The pointer to a place."""
    return begin(begin, types.intp), lambda _context, builder, _sig, args: builder.gep(args[0], [args[1]])


def _place(builder: Any, args: Any) -> Any:
    return builder.bitcast(builder.gep(args[0], [args[1]]), _DOUBLES.as_pointer())


@_instruction
def load(_typing: Any, begin: Any, place: Any) -> Any:
    """The pack of the doubles behind pointer + place."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.load(_place(builder, args), align=8)

    return _PACK(begin, types.intp), generate


@_instruction
def store(_typing: Any, begin: Any, place: Any, pack: Any) -> Any:
    """Write a pack behind pointer + place."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        builder.store(args[2], _place(builder, args), align=8)
        return context.get_dummy_value()

    return types.void(begin, types.intp, pack), generate


def _spread(builder: Any, kind: Any, value: Any) -> Any:
    index = ir.IntType(32)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(index, 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(index, WIDTH), [0] * WIDTH))


@_instruction
def broadcast(_typing: Any, value: Any) -> Any:
    """A number in every lane."""
    return _PACK(types.float64), lambda _context, builder, _sig, args: _spread(builder, _DOUBLES, args[0])


@_instruction
def word_sequence(_typing: Any, first: Any, step: Any) -> Any:
    """The words first, first + step, first + 2 step, ..."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        begin, step = (_spread(builder, _INTEGERS, number) for number in args)
        return builder.add(begin, builder.mul(step, ir.Constant(_INTEGERS, list(range(WIDTH)))))

    return _WORDS(types.uint64, types.uint64), generate


@_instruction
def wide_product(_typing: Any, pack: Any, factor: Any) -> Any:
    """Lane by lane the upper and the lower 64 bits of a product, by the halves that vectors can multiply."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        half, mask = (ir.Constant(_INTEGERS, [number] * WIDTH) for number in (32, 2**32 - 1))
        one, two = args[0], _spread(builder, _INTEGERS, args[1])
        parts = [(builder.and_(word, mask), builder.lshr(word, half)) for word in (one, two)]
        ll, lh, hl, hh = (builder.mul(x, y) for x in parts[0] for y in parts[1])
        first = builder.add(hl, builder.lshr(ll, half))
        second = builder.add(lh, builder.and_(first, mask))
        upper = builder.add(builder.add(hh, builder.lshr(first, half)), builder.lshr(second, half))
        lower = builder.or_(builder.shl(second, half), builder.and_(ll, mask))
        return context.make_tuple(builder, sig.return_type, (upper, lower))

    return types.UniTuple(_WORDS, 2)(_WORDS, types.uint64), generate


@_instruction
def upper_bits(_typing: Any, pack: Any) -> Any:
    """The upper 52 bits of every word as a number."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        # a number below 2^63 has the same value with a sign
        return builder.sitofp(builder.lshr(args[0], ir.Constant(_INTEGERS, [12] * WIDTH)), _DOUBLES)

    return _PACK(_WORDS), generate


@_instruction
def compress_store(_typing: Any, begin: Any, place: Any, pack: Any, mask: Any) -> Any:
    """Write the lanes of a mask without gaps behind pointer + place."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [_DOUBLES, ir.DoubleType().as_pointer(), _BITS])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.compressstore.v{WIDTH}f64")
        builder.call(function, [args[2], builder.gep(args[0], [args[1]]), args[3]])
        return context.get_dummy_value()

    return types.void(begin, types.intp, _PACK, _MASK), generate


@_instruction
def expand_load(_typing: Any, begin: Any, place: Any, mask: Any, others: Any) -> Any:
    """What `squeeze` wrote, in the lanes of the mask."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_DOUBLES, [ir.DoubleType().as_pointer(), _BITS, _DOUBLES])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.expandload.v{WIDTH}f64")
        return builder.call(function, [builder.gep(args[0], [args[1]]), args[2], args[3]])

    return _PACK(begin, types.intp, _MASK, _PACK), generate


@_instruction
def count_bits(_typing: Any, word: Any) -> Any:
    """How many bits are set."""
    return types.int64(types.int64), lambda _context, builder, _sig, args: builder.ctpop(args[0])


@_instruction
def where(_typing: Any, mask: Any, yes: Any, no: Any) -> Any:
    """Lane by lane `yes` where the mask is set and `no` where it is not."""
    return _PACK(_MASK, _PACK, _PACK), lambda _context, builder, _sig, args: builder.select(*args)


@_instruction
def bits(_typing: Any, mask: Any) -> Any:
    """The mask as a whole number, lane 0 in the lowest bit."""

    def generate(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(WIDTH)), ir.IntType(64))

    return types.int64(_MASK), generate


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
def absolute(_typing: Any, pack: Any) -> Any:
    """Lane by lane the absolute value."""
    return _PACK(_PACK), _by_llvm("fabs")


@_instruction
def rounded(_typing: Any, pack: Any) -> Any:
    """Lane by lane the nearest whole number, halves to the even one."""
    return _PACK(_PACK), _by_llvm("rint")


@_instruction
def square_root(_typing: Any, pack: Any) -> Any:
    """Lane by lane the square root."""
    return _PACK(_PACK), _by_llvm("sqrt")


def _operator(function: Any, operand: Any, result: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    infer: Any = infer_global

    @infer(function)
    class _Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            return signature(result, operand, operand) if args == (operand, operand) and not kws else None

    lower_builtin(function, type(operand), type(operand))(lambda _context, builder, _sig, args: emit(builder, *args))


_operator(operator.add, _PACK, _PACK, lambda builder, x, y: builder.fadd(x, y))
_operator(operator.sub, _PACK, _PACK, lambda builder, x, y: builder.fsub(x, y))
_operator(operator.mul, _PACK, _PACK, lambda builder, x, y: builder.fmul(x, y))
_operator(operator.truediv, _PACK, _PACK, lambda builder, x, y: builder.fdiv(x, y))
_operator(operator.lt, _PACK, _MASK, lambda builder, x, y: builder.fcmp_ordered("<", x, y))
_operator(operator.le, _PACK, _MASK, lambda builder, x, y: builder.fcmp_ordered("<=", x, y))
_operator(operator.gt, _PACK, _MASK, lambda builder, x, y: builder.fcmp_ordered(">", x, y))
_operator(operator.ge, _PACK, _MASK, lambda builder, x, y: builder.fcmp_ordered(">=", x, y))
_operator(operator.ne, _PACK, _MASK, lambda builder, x, y: builder.fcmp_unordered("!=", x, y))
_operator(operator.and_, _MASK, _MASK, lambda builder, x, y: builder.and_(x, y))
_operator(operator.or_, _MASK, _MASK, lambda builder, x, y: builder.or_(x, y))
_operator(operator.add, _WORDS, _WORDS, lambda builder, x, y: builder.add(x, y))
_operator(operator.xor, _WORDS, _WORDS, lambda builder, x, y: builder.xor(x, y))

# Numba infers the types of kernels, and calls what is defined here with its own.
# mypy: allow-untyped-defs, allow-untyped-calls
"""Several numbers at a time: a type for Numba, and the few operations that kernels are written in.

    v = load(array, index)                   LANES numbers that follow each other in memory
    w = select(v > 0.5, exp2(v) * 2.0, 0.0)  operators work lane by lane; a plain number stands for itself in all lanes
    store(w, array, index)                   `vector_memory.py` has what reads and writes

A kernel that uses these is compiled for the lanes that `simd.py` chooses. With one lane there is no vector: v is a
float32, a mask is a bool, and the kernel is plain Numba. Everything here takes numbers as well as vectors, so a formula
is written once for both.

Underneath is LLVM, the language that Numba translates to: its instructions have the same names for numbers and
vectors, and it knows which registers a processor has. docs/developers/kernels.md explains it.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic as numba_intrinsic
from numba.extending import lower_builtin, lower_cast, register_model

from baselines.splatting.kernels.simd import LANES as ALL_LANES
from baselines.splatting.kernels.simd import SIMD

intrinsic: Any = numba_intrinsic  # by its own types, callers would have to give the first argument
LANES, LANES64 = ALL_LANES[SIMD]  # of float32, and of float64

# A product and a sum may become one instruction; the sign of zero does not matter. Nothing that is not a number may be
# assumed away: culling relies on comparisons with it being false.
FLAGS = ("contract", "nsz")
INT32, INT64 = ir.IntType(32), ir.IntType(64)
ELEMENTS = {
    types.float32: ir.FloatType(),
    types.float64: ir.DoubleType(),
    types.int32: INT32,
    types.int64: INT64,
    types.boolean: ir.IntType(1),
}


class Vector(types.Type):
    """The type of `count` numbers of a type, or of a mask of as many bits."""

    def __init__(self, dtype: types.Type, count: int) -> None:
        self.dtype, self.count = dtype, count
        super().__init__(name=f"Vector({dtype}, {count})")

    @property
    def key(self) -> tuple[types.Type, int]:
        """What makes two types the same."""
        return self.dtype, self.count

    def can_convert_from(self, typingctx, other):
        """A plain number stands for itself in all lanes."""
        return Conversion.safe if isinstance(other, types.Number | types.Boolean) else None


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, fe_type):
        super().__init__(manager, fe_type, llvm_type(fe_type))


def lanes_of(dtype: types.Type, count: int) -> types.Type:
    """The type of so many numbers: of one, the number's own."""
    return dtype if count == 1 else Vector(dtype, count)


FLOATS, INTS = lanes_of(types.float32, LANES), lanes_of(types.int32, LANES)
DOUBLES = lanes_of(types.float64, LANES64)
FEW_FLOATS = lanes_of(types.float32, LANES64)  # as many as there are float64 lanes


def element(kind: types.Type) -> types.Type:
    """The type of one lane."""
    return kind.dtype if isinstance(kind, Vector) else types.unliteral(kind)


def count(kind: types.Type) -> int:
    """How many lanes."""
    return kind.count if isinstance(kind, Vector) else 1


def like(kind: types.Type, dtype: types.Type) -> types.Type:
    """Another type in as many lanes."""
    return lanes_of(dtype, count(kind))


def llvm_type(kind: types.Type) -> ir.Type:
    """What LLVM calls it."""
    return ir.VectorType(ELEMENTS[kind.dtype], kind.count) if isinstance(kind, Vector) else ELEMENTS[element(kind)]


def constant(kind: types.Type, value: float) -> ir.Constant:
    """A number in all lanes."""
    value = float(np.float32(value)) if element(kind) == types.float32 else value
    return ir.Constant(llvm_type(kind), [value] * kind.count if isinstance(kind, Vector) else value)


def broadcast(builder: ir.IRBuilder, number: ir.Value, kind: types.Type) -> ir.Value:
    """A number in all lanes of a type."""
    if not isinstance(kind, Vector):
        return number
    nothing = ir.Constant(llvm_type(kind), ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(INT32, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(INT32, kind.count), [0] * kind.count))


@lower_cast(types.Number, Vector)
@lower_cast(types.Boolean, Vector)
def _number_to_lanes(context, builder, from_type, to_type, value):
    return broadcast(builder, context.cast(builder, value, types.unliteral(from_type), to_type.dtype), to_type)


# --- operators --------------------------------------------------------------------------------------------------------


def common(kinds: Sequence[types.Type]) -> types.Type | None:
    """The type that the vectors among some types have; None where there is none, or several."""
    vectors = {kind for kind in kinds if isinstance(kind, Vector)}
    return vectors.pop() if len(vectors) == 1 else None


def _operator(operators: Sequence[Callable], floats: Callable | None, ints: Callable | None, compares: bool) -> None:
    """Give vectors an operator: what it emits for floats, and for integers and masks."""

    def lower(context, builder, sig, args):
        emit = floats if isinstance(element(sig.args[0]), types.Float) else ints
        assert emit is not None, f"{operators[0].__name__} of {sig.args[0]}"
        return emit(builder, *args)

    for each in operators:

        class Template(AbstractTemplate):
            key = each

            def generic(self, args, kws):
                kind = common(args)
                if kind is None or kws:
                    return None
                return signature(like(kind, types.boolean) if compares else kind, *[kind] * len(args))

        infer_global(each)(Template)
        lower_builtin(each, Vector, Vector)(lower)
        lower_builtin(each, Vector)(lower)


def _define_operators() -> None:
    def arithmetic(name: str) -> Callable:
        return lambda builder, *args: getattr(builder, name)(*args, flags=FLAGS)

    def plain(name: str) -> Callable:
        return lambda builder, *args: getattr(builder, name)(*args)

    def comparison(name: str) -> tuple[Callable, Callable]:
        ordered = "fcmp_unordered" if name == "!=" else "fcmp_ordered"
        return (
            lambda builder, a, b: getattr(builder, ordered)(name, a, b),
            lambda builder, a, b: builder.icmp_signed(name, a, b),
        )

    _operator((operator.add, operator.iadd), arithmetic("fadd"), plain("add"), False)
    _operator((operator.sub, operator.isub), arithmetic("fsub"), plain("sub"), False)
    _operator((operator.mul, operator.imul), arithmetic("fmul"), plain("mul"), False)
    _operator((operator.truediv, operator.itruediv), plain("fdiv"), None, False)
    _operator((operator.neg,), plain("fneg"), plain("neg"), False)
    _operator((operator.and_, operator.iand), None, plain("and_"), False)
    _operator((operator.or_, operator.ior), None, plain("or_"), False)
    _operator((operator.invert,), None, plain("not_"), False)
    _operator((operator.lshift,), None, plain("shl"), False)
    _operator((operator.rshift,), None, plain("ashr"), False)
    for each, name in (
        (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
        (operator.eq, "=="), (operator.ne, "!="),
    ):  # fmt: skip
        _operator((each,), *comparison(name), True)


_define_operators()

# --- functions --------------------------------------------------------------------------------------------------------


def call(builder: ir.IRBuilder, name: str, result: ir.Type, args: Sequence[ir.Value]) -> ir.Value:
    """Call one of LLVM's own functions."""
    kind = ir.FunctionType(result, [arg.type for arg in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)


def overloaded(name: str, kind: types.Type) -> str:
    """The name of one of LLVM's functions for a type: llvm.sqrt.v8f64."""
    letters = {types.float32: "f32", types.float64: "f64", types.int32: "i32", types.int64: "i64"}[element(kind)]
    return f"llvm.{name}.v{kind.count}{letters}" if isinstance(kind, Vector) else f"llvm.{name}.{letters}"


def _of_one(name: str) -> Callable:
    """A function of one number that LLVM has."""

    def typing(typingctx, x):
        def generate(context, builder, sig, args):
            return call(builder, overloaded(name, sig.return_type), args[0].type, args)

        return x(x), generate

    typing.__name__ = name
    return intrinsic(typing)


absolute = _of_one("fabs")
square_root = _of_one("sqrt")


@intrinsic
def select(typingctx, mask, a, b):
    """A where the mask is set, else b."""
    kind = common((a, b)) or lanes_of(element(a), count(mask))

    def generate(context, builder, sig, args):
        return builder.select(*args)

    return kind(mask, kind, kind), generate


def _of_two(name: str, comparison: str, integer: str) -> Callable:
    """The smaller or larger of two; of floats the second where one is not a number."""

    def typing(typingctx, a, b):
        kind = common((a, b)) or element(a)

        def generate(context, builder, sig, args):
            if isinstance(element(kind), types.Float):
                return builder.select(builder.fcmp_ordered(comparison, *args), *args)
            # not a selection: LLVM stores that as a masked store, which is slow on AMD's processors
            return call(builder, overloaded(integer, kind), args[0].type, args)

        return kind(kind, kind), generate

    typing.__name__ = name
    return intrinsic(typing)


minimum = _of_two("minimum", "<", "smin")
maximum = _of_two("maximum", ">", "smax")


@intrinsic
def whole(typingctx, x):
    """Floats without their fractions, as int32."""
    kind = like(x, types.int32)

    def generate(context, builder, sig, args):
        return builder.fptosi(args[0], llvm_type(kind))

    return kind(x), generate


@intrinsic
def lane_numbers(typingctx):
    """0, 1, ... of LANES float32."""
    numbers = [float(lane) for lane in range(LANES)]

    def generate(context, builder, sig, args):
        return ir.Constant(llvm_type(FLOATS), numbers if LANES > 1 else 0.0)

    return FLOATS(), generate


@intrinsic
def bits(typingctx, mask):
    """A mask as an int64: the first lane is the lowest bit."""

    def generate(context, builder, sig, args):
        flat = builder.bitcast(args[0], ir.IntType(count(mask))) if isinstance(mask, Vector) else args[0]
        return builder.zext(flat, INT64)

    return types.int64(mask), generate


@intrinsic
def lowest_bit(typingctx, number):
    """The place of the lowest bit that is set in an int64 other than 0."""

    def generate(context, builder, sig, args):
        return call(builder, "llvm.cttz.i64", INT64, [args[0], ir.Constant(ir.IntType(1), 1)])

    return types.int64(types.int64), generate


def _to(name: str, emit: str, source: types.Type, target: types.Type) -> Callable:
    """A change of the type of every lane; of the target's type already, as numbers among constants are, it stays."""

    def typing(typingctx, x):
        assert element(x) in (source, target), f"{name} of {x}"
        kind = like(x, target)

        def generate(context, builder, sig, args):
            return args[0] if element(x) == target else getattr(builder, emit)(args[0], llvm_type(kind))

        return kind(types.unliteral(x)), generate

    typing.__name__ = name
    return intrinsic(typing)


to_float64 = _to("to_float64", "fpext", types.float32, types.float64)
to_float32 = _to("to_float32", "fptrunc", types.float64, types.float32)
to_bits = _to("to_bits", "bitcast", types.float64, types.int64)  # the bits of a float64 as an int64
from_bits = _to("from_bits", "bitcast", types.int64, types.float64)


# --- 2^x and 1 / x ----------------------------------------------------------------------------------------------------

ROUND = 12582912.0  # 1.5 * 2^23: adding it leaves the nearest integer in the low bits of a float32
_NODES = np.cos((np.arange(256) + 0.5) * np.pi / 256) / 2 + 0.5
# of 2^f for f in [0, 1], by relative error
EXP2 = np.polynomial.polynomial.polyfit(_NODES, 2.0**_NODES, 5, w=2.0**-_NODES).astype(np.float32).tolist()


def _x86(builder: ir.IRBuilder, name: str, *args: Any) -> ir.Value:
    """One of AVX-512's own instructions on 16 floats; no lane is masked."""
    vectors = [arg for arg in args if not isinstance(arg, int)]
    numbers = [ir.Constant(INT32, arg) for arg in args if isinstance(arg, int)]
    mask = [constant(FLOATS, 0), ir.Constant(ir.IntType(16), 0xFFFF)]
    ending = [ir.Constant(INT32, 4)] if name.startswith("mask.") else []  # round as everything else does
    ordered = [*vectors, *numbers, *mask, *ending]
    return call(builder, f"llvm.x86.avx512.{name}.ps.512", vectors[0].type, ordered)


@intrinsic
def exp2(typingctx, exponent):
    """2^exponent for float32 exponents in [-126, 126], within 2e-7 relative; anything outside is meaningless."""

    def generate(context, builder, sig, args):
        def times_plus(a, b, c):
            return builder.fadd(builder.fmul(a, b, flags=FLAGS), constant(FLOATS, c), flags=FLAGS)

        def power(fraction):
            value = constant(FLOATS, EXP2[5])
            for coefficient in reversed(EXP2[:5]):
                value = times_plus(value, fraction, coefficient)
            return value

        if SIMD == "avx512":  # x - floor(x), and times 2^floor(x), are one instruction each
            fraction = _x86(builder, "mask.reduce", args[0], 1 | 8)
            return _x86(builder, "mask.scalef", power(fraction), args[0])
        shifted = builder.fadd(builder.fsub(args[0], constant(FLOATS, 0.5)), constant(FLOATS, ROUND))
        fraction = builder.fsub(args[0], builder.fsub(shifted, constant(FLOATS, ROUND)))
        ints = llvm_type(INTS)
        whole = builder.shl(builder.bitcast(shifted, ints), constant(INTS, 23))
        return builder.bitcast(builder.add(builder.bitcast(power(fraction), ints), whole), args[0].type)

    return FLOATS(FLOATS), generate


@intrinsic
def reciprocal(typingctx, x):
    """1 / x in float32, within 2e-7 relative."""

    def generate(context, builder, sig, args):
        one = constant(FLOATS, 1)
        if SIMD != "avx512":
            return builder.fdiv(one, args[0])
        first = _x86(builder, "rcp14", args[0])  # within 2^-14; Newton's step squares the error
        error = builder.fadd(builder.fmul(builder.fneg(args[0]), first, flags=FLAGS), one, flags=FLAGS)
        return builder.fadd(builder.fmul(first, error, flags=FLAGS), first, flags=FLAGS)

    return FLOATS(FLOATS), generate

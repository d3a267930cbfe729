# Numba infers the types of kernels, and calls what is defined here with its own.
# mypy: allow-untyped-defs, allow-untyped-calls
"""Vectors of `vectors.py` to and from memory, and tuples of them; arrays are flat and contiguous."""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from baselines.splatting.kernels.buffer_pool import CACHE_LINE
from baselines.splatting.kernels.jit import inlined
from baselines.splatting.kernels.vector.vectors import (
    DOUBLES,
    ELEMENTS,
    FEW_FLOATS,
    FLAGS,
    FLOATS,
    INT32,
    INT64,
    LANES,
    LANES64,
    Vector,
    broadcast,
    call,
    constant,
    element,
    intrinsic,
    lanes_of,
    llvm_type,
)


def address(context, builder, kind: ir.Type, array_type, array, index) -> ir.Value:
    """A pointer to array[index]."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), kind.as_pointer())


@intrinsic
def load(typingctx, array, index):
    """LANES numbers of an array from index on."""
    kind = lanes_of(array.dtype, LANES)

    def generate(context, builder, sig, args):
        value = builder.load(address(context, builder, llvm_type(kind), array, *args))
        value.align = 4
        return value

    return kind(array, types.int64), generate


@intrinsic
def store(typingctx, value, array, index):
    """Write LANES numbers into an array from index on."""
    kind = lanes_of(array.dtype, LANES)

    def generate(context, builder, sig, args):
        builder.store(args[0], address(context, builder, llvm_type(kind), array, *args[1:])).align = 4
        return context.get_dummy_value()

    return types.void(kind, array, types.int64), generate


@inlined
def aligned(size):
    """A flat float32 array with undefined content that begins with a cache line, see `buffer_pool.py`."""
    memory = np.empty(size + CACHE_LINE // 4, np.float32)
    start = (-memory.ctypes.data % CACHE_LINE) // 4
    return memory[start : start + size]


@intrinsic
def get(typingctx, array, index):
    """array[index] for an index from 0 on: without Numba's test for one that counts from the end."""

    def generate(context, builder, sig, args):
        return builder.load(address(context, builder, ELEMENTS[array.dtype], array, *args))

    return array.dtype(array, types.int64), generate


@intrinsic
def spread(typingctx, number):
    """A float32 or int32 in all LANES."""
    kind = lanes_of(element(number), LANES)

    def generate(context, builder, sig, args):
        return broadcast(builder, args[0], kind)

    return kind(element(number)), generate


@intrinsic
def prefetch(typingctx, array, index):
    """Have array[index] brought into the cache."""

    def generate(context, builder, sig, args):
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, INT32, INT32, INT32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        place = builder.bitcast(address(context, builder, ir.IntType(8), array, *args), byte)
        builder.call(function, [place, *(ir.Constant(INT32, number) for number in (0, 3, 1))])  # to read, often, data
        return context.get_dummy_value()

    return types.void(array, types.int64), generate


# --- parts of vectors -------------------------------------------------------------------------------------------------


def _first(builder: ir.IRBuilder, number: ir.Value, lanes: int) -> ir.Value:
    """A mask of the first `number` of some lanes."""
    places = ir.Constant(ir.VectorType(INT64, lanes), list(range(lanes)))
    return builder.icmp_signed("<", places, broadcast(builder, number, Vector(types.int64, lanes)))


def _load_first(builder: ir.IRBuilder, pointer: ir.Value, number: ir.Value, kind: ir.Type) -> ir.Value:
    """The first `number` lanes from memory, and zeros; nothing beyond them is read."""
    if not isinstance(kind, ir.VectorType):
        return builder.load(pointer, align=4)
    mask, zero = _first(builder, number, kind.count), ir.Constant(kind, [0.0] * kind.count)
    name = f"llvm.masked.load.v{kind.count}f32.p0v{kind.count}f32"
    return call(builder, name, kind, [pointer, ir.Constant(INT32, 4), mask, zero])


@intrinsic
def load_first(typingctx, number, array, index):
    """LANES float32: the first `number`, at least one, from array[index] on, and zeros; nothing else is read."""

    def generate(context, builder, sig, args):
        number, values, index = args
        kind = llvm_type(FLOATS)
        return _load_first(builder, address(context, builder, kind, array, values, index), number, kind)

    return FLOATS(types.int64, array, types.int64), generate


@intrinsic
def store_first(typingctx, number, value, array, index):
    """Write the first `number` lanes, at least one, into a float32 array from index on. Slow on AMD's processors."""

    def generate(context, builder, sig, args):
        number, value, values, index = args
        pointer = address(context, builder, value.type, array, values, index)
        if isinstance(value.type, ir.VectorType):
            name = f"llvm.masked.store.v{LANES}f32.p0v{LANES}f32"
            arguments = [value, pointer, ir.Constant(INT32, 4), _first(builder, number, LANES)]
            call(builder, name, ir.VoidType(), arguments)
        else:
            builder.store(value, pointer)
        return context.get_dummy_value()

    return types.void(types.int64, FLOATS, array, types.int64), generate


# --- several rows of an array: vectors of LANES64, a lane for a row ---------------------------------------------------


@intrinsic
def load64(typingctx, array, index):
    """LANES64 float32 of an array from index on."""

    def generate(context, builder, sig, args):
        return builder.load(address(context, builder, llvm_type(FEW_FLOATS), array, *args), align=4)

    return FEW_FLOATS(array, types.int64), generate


@intrinsic
def store64(typingctx, value, array, index):
    """Write LANES64 float32 into an array from index on."""

    def generate(context, builder, sig, args):
        builder.store(args[0], address(context, builder, llvm_type(FEW_FLOATS), array, *args[1:]), align=4)
        return context.get_dummy_value()

    return types.void(FEW_FLOATS, array, types.int64), generate


@intrinsic
def gather(typingctx, array, rows, stride, offset):
    """The float32 numbers array[rows[lane] * stride + offset] as float64; `rows` are int64 [LANES64].

    Lane by lane: quicker than the processor's own instruction on Zen 4.
    """

    def generate(context, builder, sig, args):
        values, places, stride, offset = args
        lanes = []
        for lane in range(LANES64):
            place = address(context, builder, INT64, rows, places, ir.Constant(INT64, lane))
            at = builder.add(builder.mul(builder.load(place), stride), offset)
            lanes.append(builder.load(address(context, builder, ir.FloatType(), array, values, at)))
        gathered = lanes[0] if LANES64 == 1 else ir.Constant(llvm_type(FEW_FLOATS), ir.Undefined)
        if LANES64 > 1:
            for lane, value in enumerate(lanes):
                gathered = builder.insert_element(gathered, value, ir.Constant(INT32, lane))
        return builder.fpext(gathered, llvm_type(DOUBLES))

    return DOUBLES(array, rows, types.int64, types.int64), generate


@intrinsic
def transpose(typingctx, number, array, rows, stride, offset, out, to, out_stride):
    """out[to + column out_stride + lane] = array[rows[lane] stride + offset + column] for LANES64 rows and columns.

    Only the first `number` columns are read, at least one, and the others are zero; all are written.
    """

    def generate(context, builder, sig, args):
        number, values, places, stride, offset, written, to, out_stride = args
        kind = llvm_type(FEW_FLOATS)
        vectors = []
        for lane in range(LANES64):
            place = address(context, builder, INT64, rows, places, ir.Constant(INT64, lane))
            at = builder.add(builder.mul(builder.load(place), stride), offset)
            vectors.append(_load_first(builder, address(context, builder, kind, array, values, at), number, kind))
        for column, vector in enumerate(_transposed(builder, vectors)):
            at = builder.add(to, builder.mul(out_stride, ir.Constant(INT64, column)))
            builder.store(vector, address(context, builder, kind, out, written, at), align=4)
        return context.get_dummy_value()

    number_type = types.int64
    return types.void(number_type, array, rows, *[number_type] * 2, out, *[number_type] * 2), generate


def _transposed(builder: ir.IRBuilder, vectors: list[ir.Value]) -> list[ir.Value]:
    """Columns of n vectors of n lanes, a power of two: in every round, pairs of vectors exchange halves, then quarters,
    of what they have."""
    n = len(vectors)
    half = n // 2
    while half:
        lower = [lane if not lane & half else n + lane - half for lane in range(n)]
        upper = [lane + half if not lane & half else n + lane for lane in range(n)]
        exchanged = list(vectors)
        for first in (place for place in range(n) if not place & half):
            pair = vectors[first], vectors[first + half]
            exchanged[first] = _shuffle(builder, *pair, lower)
            exchanged[first + half] = _shuffle(builder, *pair, upper)
        vectors, half = exchanged, half // 2
    return vectors


# --- tuples of vectors, one for each channel of all sets of colours ---------------------------------------------------


@intrinsic
def channels_of(typingctx, sets):
    """Three for each entry of a tuple, known when a kernel is compiled: loops over channels have no turns left."""

    def generate(context, builder, sig, args):
        return ir.Constant(INT64, 3 * sets.count)

    return types.int64(sets), generate


@intrinsic
def zeros(typingctx, sets):
    """A tuple of zeros, three for each entry of a tuple."""
    kind = types.UniTuple(FLOATS, 3 * sets.count)

    def generate(context, builder, sig, args):
        return context.make_tuple(builder, kind, [constant(FLOATS, 0)] * len(kind))

    return kind(sets), generate


@intrinsic
def spread_colours(typingctx, sets, array, index):
    """A tuple of the numbers from array[index] on, each in all LANES, three for each entry of the tuple `sets`."""
    kind = types.UniTuple(FLOATS, 3 * sets.count)

    def generate(context, builder, sig, args):
        values = []
        for channel in range(len(kind)):
            place = builder.add(args[2], ir.Constant(INT64, channel))
            number = builder.load(address(context, builder, ELEMENTS[types.float32], array, args[1], place))
            values.append(broadcast(builder, number, FLOATS))
        return context.make_tuple(builder, kind, values)

    return kind(sets, array, types.int64), generate


def _planes(count, context, builder, array_type, array, index, stride):
    """Pointers to `count` vectors of LANES floats, `stride` floats apart."""
    for channel in range(count):
        place = builder.add(index, builder.mul(stride, ir.Constant(INT64, channel)))
        yield address(context, builder, llvm_type(FLOATS), array_type, array, place)


def _load(builder, pointer):
    value = builder.load(pointer)
    value.align = 4
    return value


@intrinsic
def add_colours(typingctx, colours, weight, array, index, stride):
    """Add weight * colours[c] to the LANES numbers from array[index + stride * c] on, for every c."""

    def generate(context, builder, sig, args):
        colours, weight = cgutils.unpack_tuple(builder, args[0]), args[1]
        for colour, pointer in zip(colours, _planes(len(colours), context, builder, array, *args[2:]), strict=True):
            product = builder.fmul(weight, colour, flags=FLAGS)
            builder.store(builder.fadd(product, _load(builder, pointer), flags=FLAGS), pointer).align = 4
        return context.get_dummy_value()

    return types.void(colours, FLOATS, array, types.int64, types.int64), generate


@intrinsic
def dot_colours(typingctx, colours, array, index, stride):
    """The sum over c of colours[c] * load(array, index + stride * c)."""

    def generate(context, builder, sig, args):
        colours = cgutils.unpack_tuple(builder, args[0])
        total = None
        for colour, pointer in zip(colours, _planes(len(colours), context, builder, array, *args[1:]), strict=True):
            product = builder.fmul(colour, _load(builder, pointer), flags=FLAGS)
            total = product if total is None else builder.fadd(product, total, flags=FLAGS)
        return total

    return FLOATS(colours, array, types.int64, types.int64), generate


@intrinsic
def add_scaled(typingctx, sums, weight, array, index, stride):
    """A tuple sums[c] + weight * load(array, index + stride * c)."""

    def generate(context, builder, sig, args):
        sums, weight = cgutils.unpack_tuple(builder, args[0]), args[1]
        added = []
        for total, pointer in zip(sums, _planes(len(sums), context, builder, array, *args[2:]), strict=True):
            product = builder.fmul(weight, _load(builder, pointer), flags=FLAGS)
            added.append(builder.fadd(product, total, flags=FLAGS))
        return context.make_tuple(builder, sig.return_type, added)

    return sums(sums, FLOATS, array, types.int64, types.int64), generate


@intrinsic
def store_sums(typingctx, values, array, index):
    """Write the sum over lanes of each of a tuple's vectors, one after the other; zeros up to a multiple of LANES."""

    def generate(context, builder, sig, args):
        vectors = cgutils.unpack_tuple(builder, args[0])
        for start in range(0, len(vectors), LANES):
            part = vectors[start : start + LANES]
            sums = _sums(builder, part + [constant(FLOATS, 0)] * (LANES - len(part)))
            place = builder.add(args[2], ir.Constant(INT64, start))
            builder.store(sums, address(context, builder, llvm_type(FLOATS), array, args[1], place)).align = 4
        return context.get_dummy_value()

    return types.void(values, array, types.int64), generate


def _sums(builder: ir.IRBuilder, vectors: list[ir.Value]) -> ir.Value:
    """The sums over lanes of n vectors of n lanes, as one vector; n is a power of two.

    In every round two vectors become one that holds half as many partial sums of each, until a lane is a vector's sum.
    """
    rounds = _rounds(len(vectors))
    places = [[place] * len(vectors) for place in range(len(vectors))]  # which vector the lanes of each are sums of
    for low, _ in rounds:
        places = [[(a + b)[lane] for lane in low] for a, b in zip(places[::2], places[1::2], strict=True)]
    vectors = [vectors[places[0].index(place)] for place in range(len(vectors))]
    for low, high in rounds:
        vectors = [
            builder.fadd(_shuffle(builder, a, b, low), _shuffle(builder, a, b, high), flags=FLAGS)
            for a, b in zip(vectors[::2], vectors[1::2], strict=True)
        ]
    return vectors[0]


def _rounds(n: int) -> list[tuple[list[int], list[int]]]:
    """For each round, which lanes of two vectors of n lanes, counted through, are added: the first and the second.

    Whole quarters of four lanes are moved first, lanes within them last: processors do that in one instruction.
    """
    rounds = []
    half = n // 2
    while half >= 1:
        if half >= 4:
            low = [lane for start in range(0, 2 * n, 2 * half) for lane in range(start, start + half)]
        else:
            inside = (0, 1) if half == 2 else (0, 2)
            low = [vector + quarter + lane for quarter in range(0, n, 4) for vector in (0, n) for lane in inside]
        rounds.append((low, [lane + half for lane in low]))
        half //= 2
    return rounds


def _shuffle(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, lanes: list[int]) -> ir.Value:
    """The lanes of two vectors, counted through, in another order."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT32, len(lanes)), lanes))

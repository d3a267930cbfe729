"""Eight float32 lanes at a time: the operations that the blending rows are written in, as LLVM vector code.

    2^x = 2^n p(f),      n = round(x), f = x - n, p of degree 5

is the one function among them; n is added to the exponent's bits. docs/how-it-works/kernels.md explains the rest.

LLVM maps `<8 x float>` to AVX, two SSE or two NEON registers. Spelled out because automatic vectorisation left the
backward pass 2.7 times slower.
"""

from collections.abc import Callable, Sequence

import numpy as np
from llvmlite import ir
from numba.core import cgutils

from baselines.splatting.kernels.constants import LOG2_MIN_ALPHA, MAX_ALPHA, MIN_TRANSMITTANCE

LANES = 8
BLOCK_BYTES = 4 * LANES  # one register of floats in memory

FLOAT, INT32, INT64 = ir.FloatType(), ir.IntType(32), ir.IntType(64)
FLOATS, INTS = ir.VectorType(FLOAT, LANES), ir.VectorType(INT32, LANES)
FLAGS = ("contract", "nsz")

ROUND = 12582912.0  # 1.5 * 2^23: adding it leaves the nearest integer in the low bits of a float32
_NODES = np.cos((np.arange(64) + 0.5) * np.pi / 64) / 2
EXP2 = [float(np.float32(c)) for c in np.polynomial.polynomial.polyfit(_NODES, 2.0**_NODES, 5)]

# Numba's large code model makes every literal vector an address load and a memory load; a table in hand is cheaper.
CONSTANTS = np.array([*EXP2, ROUND, MAX_ALPHA, MIN_TRANSMITTANCE, LOG2_MIN_ALPHA, 1, LANES], np.float32)


class Lanes:
    """Emits vector operations into an LLVM builder; `table` is the address of CONSTANTS."""

    def __init__(self, builder: ir.IRBuilder, table: ir.Value):
        self.builder = builder
        self.table = table
        triple = ir.FunctionType(FLOATS, [FLOATS] * 3)
        self._fma = cgutils.get_or_insert_function(builder.module, triple, f"llvm.fmuladd.v{LANES}f32")
        single = ir.FunctionType(FLOATS, [FLOATS])
        self._fabs = cgutils.get_or_insert_function(builder.module, single, f"llvm.fabs.v{LANES}f32")

    def constant(self, value: float) -> ir.Value:
        """A literal in all lanes; other than 0 it must be one of CONSTANTS."""
        if value == 0:
            return ir.Constant(FLOATS, [0.0] * LANES)
        index = CONSTANTS.tolist().index(float(np.float32(value)))
        address = self.builder.add(self.table, ir.Constant(INT64, 4 * index))
        return self.splat(self.builder.load(self.builder.inttoptr(address, FLOAT.as_pointer())))

    def splat(self, scalar: ir.Value) -> ir.Value:
        """A scalar in all lanes."""
        nothing = ir.Constant(FLOATS, ir.Undefined)
        first = self.builder.insert_element(nothing, scalar, ir.Constant(INT32, 0))
        return self.builder.shuffle_vector(first, nothing, ir.Constant(INTS, [0] * LANES))

    def scalars(self, address: ir.Value, count: int) -> list[ir.Value]:
        """`count` floats that follow each other in memory, each in all lanes."""
        pointer = self.builder.inttoptr(address, FLOAT.as_pointer())
        numbers = (ir.Constant(INT64, number) for number in range(count))
        return [self.splat(self.builder.load(self.builder.gep(pointer, [number]))) for number in numbers]

    def lane_numbers(self) -> ir.Value:
        """0, 1, ... 7."""
        return ir.Constant(FLOATS, [float(k) for k in range(LANES)])

    def fma(self, a: ir.Value, b: ir.Value, c: ir.Value) -> ir.Value:
        """a b + c."""
        return self.builder.call(self._fma, [a, b, c])

    def add(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """a + b."""
        return self.builder.fadd(a, b, flags=FLAGS)

    def subtract(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """a - b."""
        return self.builder.fsub(a, b, flags=FLAGS)

    def multiply(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """a b."""
        return self.builder.fmul(a, b, flags=FLAGS)

    def divide(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """a / b."""
        return self.builder.fdiv(a, b)

    def negate(self, a: ir.Value) -> ir.Value:
        """-a."""
        return self.builder.fneg(a)

    def absolute(self, a: ir.Value) -> ir.Value:
        """|a|."""
        return self.builder.call(self._fabs, [a])

    def at_least(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """Mask a >= b; false for NaN."""
        return self.builder.fcmp_ordered(">=", a, b)

    def both(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """Mask a and b."""
        return self.builder.and_(a, b)

    def select(self, mask: ir.Value, a: ir.Value, b: ir.Value) -> ir.Value:
        """A where the mask is set, else b."""
        return self.builder.select(mask, a, b)

    def minimum(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """The smaller one."""
        return self.select(self.builder.fcmp_ordered("<", a, b), a, b)

    def maximum(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """The larger one."""
        return self.select(self.builder.fcmp_ordered("<", b, a), a, b)

    def negative_where(self, mask: ir.Value, a: ir.Value) -> ir.Value:
        """A with its sign bit set where the mask is."""
        sign = self.builder.select(mask, ir.Constant(INTS, [-(2**31)] * LANES), ir.Constant(INTS, [0] * LANES))
        bits = self.builder.or_(self.builder.bitcast(a, INTS), sign)
        return self.builder.bitcast(bits, FLOATS)

    def load(self, address: ir.Value, plane: int = 0) -> ir.Value:
        """The lanes `plane` registers after an address."""
        value = self.builder.load(self._pointer(address, plane))
        value.align = 4
        return value

    def store(self, value: ir.Value, address: ir.Value, plane: int = 0) -> None:
        """Write lanes. Never `store(select(mask, new, old))`: LLVM makes that a masked store, very slow on AMD Zen."""
        self.builder.store(value, self._pointer(address, plane)).align = 4

    def _pointer(self, address: ir.Value, plane: int) -> ir.Value:
        moved = self.builder.add(address, ir.Constant(INT64, plane * BLOCK_BYTES)) if plane else address
        return self.builder.inttoptr(moved, FLOATS.as_pointer())

    def exp2(self, exponent: ir.Value) -> ir.Value:
        """2^exponent for exponents in [-126, 126], within 3e-7 relative; anything outside is meaningless."""
        shifted = self.builder.fadd(exponent, self.constant(ROUND))
        whole = self.builder.shl(self.builder.bitcast(shifted, INTS), ir.Constant(INTS, [23] * LANES))
        fraction = self.builder.fsub(exponent, self.builder.fsub(shifted, self.constant(ROUND)))
        power = self.constant(EXP2[5])
        for coefficient in reversed(EXP2[:5]):
            power = self.fma(power, fraction, self.constant(coefficient))
        return self.builder.bitcast(self.builder.add(self.builder.bitcast(power, INTS), whole), FLOATS)

    def loop(self, count: ir.Value, starts: Sequence[tuple[ir.Value, ir.Value]], body: Callable[..., None]) -> None:
        """Run `body` `count` >= 1 times on variables given as (start, step); steps are added after each turn."""
        builder = self.builder
        before, turn, after = builder.block, builder.append_basic_block("turn"), builder.append_basic_block("after")
        builder.branch(turn)
        builder.position_at_end(turn)
        left = builder.phi(INT64)
        left.add_incoming(count, before)
        variables = []
        for start, _ in starts:
            variables.append(builder.phi(start.type))
            variables[-1].add_incoming(start, before)
        body(*variables)
        for variable, (_, step) in zip(variables, starts, strict=True):
            moved = self.add(variable, step) if variable.type == FLOATS else builder.add(variable, step)
            variable.add_incoming(moved, builder.block)
        remaining = builder.sub(left, ir.Constant(INT64, 1))
        left.add_incoming(remaining, builder.block)
        builder.cbranch(builder.icmp_signed(">", remaining, ir.Constant(INT64, 0)), turn, after)
        builder.position_at_end(after)

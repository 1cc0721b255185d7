"""Vector operations for compiled loops, in LLVM's intermediate representation.

Numba vectorises neither short loops, which it unrolls, nor loops over arrays that may overlap.
Measured savings of encoding time:

=================  ==============================  ==========
function           codec                           time saved
=================  ==============================  ==========
``add_scaled``     ``puck``, effort ``thorough``   24 %
``decay_and_add``  ``puck``, effort ``thorough``   28 %
``add_products``   ``sparse_octree_net``           57 %
``add_products``   ``reno``                        88 %
``add_floats``     ``pcgcv2_plus``                 13 %
=================  ==============================  ==========

A plain loop (``..._loop``) with equal results replaces each function if llvmlite cannot write the
vector code, or if indices are checked (``NUMBA_BOUNDSCHECK=1``). Arrays must be flat, contiguous
and disjoint.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numpy.typing import NDArray

from pointkit.compiling import inlined, intrinsic

Words = NDArray[np.int32]
Rows = NDArray[np.int64]
Floats32 = NDArray[np.float32]
Lanes = tuple[int, ...]
"""Tuple of zeros as long as a vector: the length is part of the type, hence constant for LLVM."""

LANES = 8
"""Lengths of integer vectors are multiples of this number."""
_BLOCK = 4
"""Number of pairs of rows that are summed in registers at a time."""
_BYTES = 4
_MOST_FLOATS = 32
"""Length of a vector of floats at most."""
_config: Any = numba.config
_WORD, _LONG = ir.IntType(32), ir.IntType(64)
_WORDS, _LONGS = ir.VectorType(_WORD, LANES), ir.VectorType(_LONG, LANES)
_CANNOT_BE_WRITTEN = (AttributeError, NotImplementedError, TypeError, ValueError)


@inlined
def bit_count(word: int) -> int:
    """Return the number of set bits of a 64-bit word."""
    pairs = word - ((word >> 1) & 0x5555555555555555)
    fours = (pairs & 0x3333333333333333) + ((pairs >> 2) & 0x3333333333333333)
    eights = (fours + (fours >> 4)) & 0x0F0F0F0F0F0F0F0F
    return (eights * 0x0101010101010101) >> 56


@inlined
def dot(left: Words, i: int, right: Words, j: int, lanes: Lanes) -> int:
    """Return the sum of ``left[i + k] * right[j + k]`` over the lanes k, in 64 bits."""
    total = np.int64(0)
    for k in range(len(lanes)):
        total += np.int64(left[np.uint64(i + k)]) * np.int64(right[np.uint64(j + k)])
    return int(total)


def lanes_for(numbers: int) -> Lanes:
    """Return the lanes of a vector that has room for the given number of elements.

    The length is a multiple of `LANES`.
    """
    return (0,) * (-(-numbers // LANES) * LANES)


def add_scaled_loop(
    onto: Words, i: int, numbers: Words, factor: int, shift: int, lanes: Lanes
) -> None:
    """Do what `add_scaled` does."""
    for k in range(len(lanes)):
        product = np.int64(numbers[k]) * factor
        onto[i + k] += np.int32((product + (1 << (shift - 1))) >> shift)


def decay_and_add_loop(
    onto: Words, i: int, numbers: Words, factor: int, damp: int, slow: int, lanes: Lanes
) -> None:
    """Do what `decay_and_add` does."""
    for k in range(len(lanes)):
        product = np.int32(np.int64(numbers[k]) * factor)
        onto[i + k] += np.int32((product >> damp) - (onto[i + k] >> slow))


def add_products_loop(
    sums: Floats32, targets: Rows, read: Floats32, sources: Rows, pairs: int, kernel: Floats32,
    at: int, width: int, wider: int,
) -> None:  # fmt: skip
    """Do what `add_products` does."""
    for pair in range(pairs):
        onto, row = targets[pair] * wider, sources[pair] * width
        for k in range(width):
            for j in range(wider):
                weight = kernel[at + k * wider + j]
                sums[onto + j] = fused_multiply_add(read[row + k], weight, sums[onto + j])


def copy_floats_loop(onto: Floats32, i: int, source: Floats32, j: int, width: int) -> None:
    """Copy `width` numbers of `source`, from index j on, to `onto`, from index i on."""
    for k in range(width):
        onto[i + k] = source[j + k]


def add_floats_loop(onto: Floats32, i: int, source: Floats32, j: int, width: int) -> None:
    """Add `width` numbers of `source`, from index j on, to those of `onto`, from index i on."""
    for k in range(width):
        onto[i + k] += source[j + k]


@inlined
def fused_multiply_add(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    """Return a * b + c with a single rounding (IEEE 754).

    Rounding the sum in double precision to odd makes the final rounding correct (Boldo and
    Melquiond 2008).
    """
    product = np.float64(a) * np.float64(b)  # exact
    total = product + np.float64(c)
    added = total - product
    error = (product - (total - added)) + (np.float64(c) - added)
    if abs(error) > 0.0:
        bits = np.float64(total).view(np.int64)
        if bits & 1 == 0:
            bits += 1 if (error > 0.0) == (total > 0.0) else -1
            total = np.int64(bits).view(np.float64)
    return np.float32(total)


Write = Callable[[Any, Any, Any, Any], Any]
"""Function that writes LLVM code from Numba's context, LLVM's builder, signature and values."""


def _or_loop(write: Write, loop: Callable[..., None]) -> Write:
    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        if _config.BOUNDSCHECK or not _can_be_written(write, context, signature):
            return context.compile_internal(builder, loop, signature, values)
        write(context, builder, signature, values)
        return context.get_dummy_value()

    return code


def _can_be_written(write: Write, context: Any, signature: Any) -> bool:
    kinds = [context.get_value_type(kind) for kind in signature.args]
    function = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), kinds), "trial")
    builder = ir.IRBuilder(function.append_basic_block())
    try:
        write(context, builder, signature, function.args)
    except _CANNOT_BE_WRITTEN:
        return False
    return True


def _data(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return context.make_array(kind)(context, builder, array).data


def _parts(builder: Any, data: Any, first: Any, count: int) -> list[Any]:
    start = builder.gep(data, [first])
    return [
        builder.bitcast(builder.gep(start, [_LONG(part)]), _WORDS.as_pointer())
        for part in range(0, count, LANES)
    ]


def _spread(builder: Any, number: Any, kind: Any) -> Any:
    single = builder.insert_element(kind(ir.Undefined), number, _WORD(0))
    mask = ir.Constant(ir.VectorType(_WORD, kind.count), [0] * kind.count)
    return builder.shuffle_vector(single, kind(ir.Undefined), mask)


def _words_of(builder: Any, number: Any) -> Any:
    return _spread(builder, builder.trunc(number, _WORD), _WORDS)


def _update(
    context: Any, builder: Any, signature: Any, values: Any, step_of: Callable[[Any, Any], Any]
) -> None:
    onto, numbers, count = signature.args[0], signature.args[2], signature.args[-1].count
    targets = _parts(builder, _data(context, builder, onto, values[0]), values[1], count)
    sources = _parts(builder, _data(context, builder, numbers, values[2]), _LONG(0), count)
    loaded = [builder.load(source, align=_BYTES) for source in sources]
    for target, number in zip(targets, loaded, strict=True):
        old = builder.load(target, align=_BYTES)
        builder.store(builder.add(old, step_of(old, number)), target, align=_BYTES)


def _add_scaled(
    typing: Any, onto: Any, i: Any, numbers: Any, factor: Any, shift: Any, lanes: Any
) -> Any:
    bits = shift.literal_value

    def write(context: Any, builder: Any, signature: Any, values: Any) -> None:
        factors = builder.sext(_words_of(builder, values[3]), _LONGS)
        half, shifts = (ir.Constant(_LONGS, [n] * LANES) for n in (1 << bits - 1, bits))

        def step_of(old: Any, number: Any) -> Any:
            product = builder.add(builder.mul(builder.sext(number, _LONGS), factors), half)
            return builder.trunc(builder.ashr(product, shifts), _WORDS)

        _update(context, builder, signature, values, step_of)

    signature = types.void(onto, types.int64, numbers, types.int64, shift, lanes)
    return signature, _or_loop(write, add_scaled_loop)


def _decay_and_add(
    typing: Any, onto: Any, i: Any, numbers: Any, factor: Any, damp: Any, slow: Any, lanes: Any
) -> Any:
    def write(context: Any, builder: Any, signature: Any, values: Any) -> None:
        factors, damps, slows = (_words_of(builder, value) for value in values[3:6])

        def step_of(old: Any, number: Any) -> Any:
            grown = builder.ashr(builder.mul(number, factors), damps)
            return builder.sub(grown, builder.ashr(old, slows))

        _update(context, builder, signature, values, step_of)

    signature = types.void(onto, types.int64, numbers, *[types.int64] * 3, lanes)
    return signature, _or_loop(write, decay_and_add_loop)


class _Products:
    def __init__(self, context: Any, builder: Any, kinds: Any, values: Any) -> None:
        self.builder = builder
        self.size = context.get_value_type(types.intp)
        self.sums, self.targets, self.read, self.sources, self.kernel = (
            _data(context, builder, kinds[place], values[place]) for place in (0, 1, 2, 3, 5)
        )
        self.pairs, self.at = values[4], values[6]
        self.width, self.wider = (kinds[place].literal_value for place in (7, 8))
        self.row = ir.VectorType(ir.FloatType(), self.wider)

    def write(self) -> None:
        builder, block = self.builder, self.number(_BLOCK)
        blocks = builder.sdiv(self.pairs, block)
        with cgutils.for_range(builder, blocks) as loop:
            self.block(builder.mul(loop.index, block), _BLOCK)
        done = builder.mul(blocks, block)
        with cgutils.for_range(builder, builder.sub(self.pairs, done)) as loop:
            self.block(builder.add(done, loop.index), 1)

    def block(self, first: Any, count: int) -> None:
        builder = self.builder
        pairs = [builder.add(first, self.number(i)) for i in range(count)]
        targets = [
            self.vector(self.sums, self.start(self.targets, pair, self.wider)) for pair in pairs
        ]
        sources = [self.start(self.sources, pair, self.width) for pair in pairs]
        alloca: Any = cgutils.alloca_once
        sums = [alloca(builder, self.row) for _ in pairs]
        for total, target in zip(sums, targets, strict=True):
            builder.store(builder.load(target, align=_BYTES), total)
        with cgutils.for_range(builder, self.number(self.width)) as loop:
            place = builder.add(self.at, builder.mul(loop.index, self.number(self.wider)))
            weights = builder.load(self.vector(self.kernel, place), align=_BYTES)
            for total, source in zip(sums, sources, strict=True):
                self.add(total, builder.add(source, loop.index), weights)
        for total, target in zip(sums, targets, strict=True):
            builder.store(builder.load(total), target, align=_BYTES)

    def add(self, total: Any, source: Any, weights: Any) -> None:
        builder = self.builder
        feature = builder.load(builder.gep(self.read, [source]))
        factors, old = _spread(builder, feature, self.row), builder.load(total)
        builder.store(builder.call(self.fused_multiply_add(), [factors, weights, old]), total)

    def fused_multiply_add(self) -> Any:
        kind = ir.FunctionType(self.row, [self.row] * 3)
        declare: Any = cgutils.get_or_insert_function
        return declare(self.builder.module, kind, f"llvm.fma.v{self.wider}f32")

    def number(self, value: int) -> Any:
        return ir.Constant(self.size, value)

    def start(self, rows: Any, pair: Any, width: int) -> Any:
        row = self.builder.load(self.builder.gep(rows, [pair]))
        return self.builder.mul(row, self.number(width))

    def vector(self, data: Any, at: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(data, [at]), self.row.as_pointer())


def _add_products(
    typing: Any, sums: Any, targets: Any, read: Any, sources: Any, pairs: Any, kernel: Any,
    at: Any, width: Any, wider: Any,
) -> Any:  # fmt: skip
    if not all(isinstance(size, types.IntegerLiteral) for size in (width, wider)):
        return None

    def write(context: Any, builder: Any, signature: Any, values: Any) -> None:
        _Products(context, builder, signature.args, values).write()

    kinds = (sums, targets, read, sources, types.intp, kernel, types.intp, width, wider)
    return types.void(*kinds), _or_loop(write, add_products_loop)


def _moving(loop: Callable[..., None], is_sum: bool) -> Callable[..., Any]:
    def move(typing: Any, onto: Any, i: Any, source: Any, j: Any, width: Any) -> Any:
        if not isinstance(width, types.IntegerLiteral):
            return None

        def write(context: Any, builder: Any, signature: Any, values: Any) -> None:
            kinds, size = signature.args, context.get_value_type(types.intp)
            for start in range(0, width.literal_value, _MOST_FLOATS):
                count = min(_MOST_FLOATS, width.literal_value - start)
                vector = ir.VectorType(ir.FloatType(), count).as_pointer()
                target, read = (
                    builder.bitcast(
                        builder.gep(
                            _data(context, builder, kinds[place], values[place]),
                            [builder.add(values[place + 1], ir.Constant(size, start))],
                        ),
                        vector,
                    )
                    for place in (0, 2)
                )
                moved = builder.load(read, align=_BYTES)
                if is_sum:
                    moved = builder.fadd(builder.load(target, align=_BYTES), moved)
                builder.store(moved, target, align=_BYTES)

        kinds = (onto, types.intp, source, types.intp, width)
        return types.void(*kinds), _or_loop(write, loop)

    return move


def _leading_zeros(typing: Any, word: Any) -> Any:
    def write(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.ctlz(values[0], ir.Constant(ir.IntType(1), 0))

    return types.int64(types.int64), write


copy_floats: Any = intrinsic(_moving(copy_floats_loop, is_sum=False), prefer_literal=True)
"""``copy_floats(onto, i, source, j, width)``: copy ``source[j : j + width]`` to ``onto[i : i +
width]``. Both are arrays of float32, and the width is a constant."""
add_floats: Any = intrinsic(_moving(add_floats_loop, is_sum=True), prefer_literal=True)
"""``add_floats(onto, i, source, j, width)``: add ``source[j : j + width]`` to ``onto[i : i +
width]``. Both are arrays of float32, and the width is a constant."""
leading_zeros: Any = intrinsic(_leading_zeros)
"""``leading_zeros(word)``: the number of leading zero bits of a 64-bit word."""
add_scaled: Any = intrinsic(_add_scaled, prefer_literal=True)
"""``add_scaled(onto, i, numbers, factor, shift, lanes)``: add ``(numbers[k] * factor + 2 ** (shift
- 1)) >> shift`` to each ``onto[i + k]``; the factor has 32 bits, the shift is a constant."""
decay_and_add: Any = intrinsic(_decay_and_add)
"""``decay_and_add(onto, i, numbers, factor, damp, slow, lanes)``: add ``(numbers[k] * factor >>
damp) - (onto[i + k] >> slow)`` to each ``onto[i + k]``, in 32 bits."""
add_products: Any = intrinsic(_add_products, prefer_literal=True)
"""``add_products(sums, targets, read, sources, pairs, kernel, at, width, wider)``: for the first
`pairs` pairs of a target row of `sums` and a source row of `read`, compute ``sums[target] +=
read[source] @ matrix``. Targets are distinct. The (width, wider) matrix begins at ``kernel[at]``.
Fused multiply-adds in the order of the matrix's rows give the same bits on every machine."""

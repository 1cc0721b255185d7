"""Sums and updates of short vectors of 32-bit integers, in LLVM's vector instructions.

Numba makes no vectors of loops that it unrolls, and checks for overlaps before those that it does
not. Results are those of the loops, on every machine: integers wrap alike everywhere.

A vector's length is that of a tuple (`lanes`), which is part of the tuple's type: a multiple of
eight. Arrays are contiguous; places in them count elements, also where they have several axes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types

from puckbench.core.compiling import intrinsic

LANES = 8
"""Numbers of one instruction; lengths are multiples of it."""
_BYTES = 4
_config: Any = numba.config
_check: Any = cgutils.do_boundscheck
_WORD, _LONG = ir.IntType(32), ir.IntType(64)
_WORDS, _LONGS = ir.VectorType(_WORD, LANES), ir.VectorType(_LONG, LANES)


def lanes_for(numbers: int) -> tuple[int, ...]:
    """A tuple whose length is the least of a vector of so many numbers."""
    return (0,) * (-(-numbers // LANES) * LANES)


def _parts(context: Any, builder: Any, kind: Any, array: Any, first: Any, count: int) -> Any:
    """Pointers to a vector's parts; with checked indices, both its ends are looked at."""
    found = context.make_array(kind)(context, builder, array)
    if _config.BOUNDSCHECK:
        for place in (first, builder.add(first, _LONG(count - 1))):
            _check(context, builder, place, found.nitems, 0)
    start = builder.gep(found.data, [first])
    return [
        builder.bitcast(builder.gep(start, [_LONG(part)]), _WORDS.as_pointer())
        for part in range(0, count, LANES)
    ]


def _loaded(builder: Any, pointers: Any) -> Iterator[Any]:
    for pointer in pointers:
        yield builder.load(pointer, align=_BYTES)


def _spread(builder: Any, number: Any, kind: Any) -> Any:
    """A vector of one number."""
    one = builder.insert_element(kind(ir.Undefined), number, _WORD(0))
    mask = ir.Constant(ir.VectorType(_WORD, LANES), [0] * LANES)
    return builder.shuffle_vector(one, kind(ir.Undefined), mask)


def _constant(kind: Any, number: int) -> Any:
    return ir.Constant(kind, [number] * LANES)


def _sum(builder: Any, vector: Any) -> Any:
    """The sum of a vector's numbers: its halves are added until there is one."""
    half = LANES // 2
    while half:
        halves = (
            ir.Constant(ir.VectorType(_WORD, half), list(range(start, start + half)))
            for start in (0, half)
        )
        low, high = (builder.shuffle_vector(vector, vector, mask) for mask in halves)
        vector, half = builder.add(low, high), half // 2
    return builder.extract_element(vector, _WORD(0))


def _as_vector(typing: Any, numbers: Any, lanes: Any) -> Any:
    """Typing and machine code of `as_vector`."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        first = _LONG(0)
        pointers = _parts(context, builder, numbers, values[0], first, lanes.count)
        for pointer in pointers:
            vector, words = _WORDS(ir.Undefined), builder.bitcast(pointer, _WORD.as_pointer())
            for k in range(LANES):
                one = builder.load(builder.gep(words, [_WORD(k)]), align=_BYTES)
                vector = builder.insert_element(vector, one, _WORD(k))
            builder.store(vector, pointer, align=_BYTES)
        return context.get_dummy_value()

    return types.void(numbers, lanes), code


def _dot(typing: Any, left: Any, i: Any, right: Any, j: Any, lanes: Any) -> Any:
    """Typing and machine code of `dot`."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        rows = [
            _loaded(
                builder,
                _parts(context, builder, signature.args[k], values[k], values[k + 1], lanes.count),
            )
            for k in (0, 2)
        ]
        total = None
        for one, other in zip(*rows, strict=True):
            product = builder.mul(builder.sext(one, _LONGS), builder.sext(other, _LONGS))
            total = product if total is None else builder.add(total, product)
        return _sum(builder, total)

    return types.int64(left, types.int64, right, types.int64, lanes), code


def _add_scaled(
    typing: Any, onto: Any, i: Any, numbers: Any, factor: Any, shift: Any, lanes: Any
) -> Any:
    """Typing and machine code of `add_scaled`."""
    bits = shift.literal_value

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array, first, source, by, _, _ = values
        targets = _parts(context, builder, onto, array, first, lanes.count)
        origins = _parts(context, builder, numbers, source, _LONG(0), lanes.count)
        factors = builder.sext(_spread(builder, builder.trunc(by, _WORD), _WORDS), _LONGS)
        for target, number in zip(targets, list(_loaded(builder, origins)), strict=True):
            step = builder.mul(builder.sext(number, _LONGS), factors)
            step = builder.add(step, _constant(_LONGS, 1 << bits - 1))
            step = builder.trunc(builder.ashr(step, _constant(_LONGS, bits)), _WORDS)
            builder.store(
                builder.add(builder.load(target, align=_BYTES), step), target, align=_BYTES
            )
        return context.get_dummy_value()

    return types.void(onto, types.int64, numbers, types.int64, shift, lanes), code


def _decay_and_add(
    typing: Any, onto: Any, i: Any, numbers: Any, factor: Any, damp: Any, slow: Any, lanes: Any
) -> Any:
    """Typing and machine code of `decay_and_add`."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array, first, source, by, less, loss, _ = values
        targets = _parts(context, builder, onto, array, first, lanes.count)
        origins = _parts(context, builder, numbers, source, _LONG(0), lanes.count)
        factors, shifts, losses = (
            _spread(builder, builder.trunc(number, _WORD), _WORDS) for number in (by, less, loss)
        )
        for target, number in zip(targets, list(_loaded(builder, origins)), strict=True):
            old = builder.load(target, align=_BYTES)
            step = builder.ashr(builder.mul(number, factors), shifts)
            step = builder.sub(step, builder.ashr(old, losses))
            builder.store(builder.add(old, step), target, align=_BYTES)
        return context.get_dummy_value()

    signature = types.void(onto, types.int64, numbers, *[types.int64] * 3, lanes)
    return signature, code


as_vector: Any = intrinsic(_as_vector)
"""``as_vector(numbers, lanes)``: no change, but numbers that were stored one by one are stored as
vectors again: where a vector is loaded just after its numbers were stored, a processor waits."""
dot: Any = intrinsic(_dot)
"""``dot(left, i, right, j, lanes)``: the sum of ``left[i + k] * right[j + k]``, in 64 bits."""
add_scaled: Any = intrinsic(_add_scaled, prefer_literal=True)
"""``add_scaled(onto, i, numbers, factor, shift, lanes)``: ``onto[i + k] += (numbers[k] * factor +
2 ** (shift - 1)) >> shift``; the factor has 32 bits, the shift is a constant."""
decay_and_add: Any = intrinsic(_decay_and_add)
"""``decay_and_add(onto, i, numbers, factor, damp, slow, lanes)``: ``onto[i + k] += (numbers[k] *
factor >> damp) - (onto[i + k] >> slow)``, in 32 bits."""

"""Products of features and matrices for pairs of rows, written in LLVM's vector instructions.

A sparse convolution is, for each offset, a product of a small matrix with the features of the rows
that have a neighbour there. Four pairs at a time stay in registers from beginning to end, so that
nothing is gathered before and scattered afterwards. Operands and sums must be such that single
precision holds them exactly, as fixed-point numbers do: a multiplication that is fused with its
addition then changes nothing. For other numbers there is `add_fused_products`, in which every
multiplication is fused with its addition (one rounding, IEEE 754's fusedMultiplyAdd) and a row's
sum grows in the order of the pairs and columns, so that every machine gets the same bits.

Like `vector_moves` it is written in LLVM's intermediate representation: numba cannot prove that the
arrays do not overlap and leaves the loops in single steps. With the same loops in plain numba
the sparse octree net encodes five and decodes four times more slowly (chair_01 at r4: 1.89 s and
1.78 s of processor time against 0.38 s and 0.44 s).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from puckbench.core.compiling import intrinsic

_TOGETHER = 4
_FLOAT_BYTES = 4
_FUSED = ("contract",)


class _Writer:
    """Writes the code of one call: arrays' memory, and blocks of pairs."""

    def __init__(self, context: Any, builder: Any, kinds: Any, values: Any, fused: bool) -> None:
        self.builder, self.fused = builder, fused
        self.size = context.get_value_type(types.intp)
        self.data = {
            place: context.make_array(kinds[place])(context, builder, values[place]).data
            for place in (0, 1, 2, 3, 5)
        }
        self.pairs, self.at = values[4], values[6]
        self.width, self.wider = (kinds[place].literal_value for place in (7, 8))

    def number(self, value: int) -> Any:
        return ir.Constant(self.size, value)

    def row(self, place: int, pair: Any, width: int) -> Any:
        """Where in an array of features the row of a pair begins."""
        row = self.builder.load(self.builder.gep(self.data[place], [pair]))
        return self.builder.mul(row, self.number(width))

    def vector(self, place: int, at: Any) -> Any:
        kind = ir.VectorType(ir.FloatType(), self.wider)
        return self.builder.bitcast(self.builder.gep(self.data[place], [at]), kind.as_pointer())

    def block(self, first: Any, many: int) -> None:
        """Add the products of `many` pairs from the `first` on."""
        builder = self.builder
        pairs = [builder.add(first, self.number(i)) for i in range(many)]
        targets = [self.vector(0, self.row(1, pair, self.wider)) for pair in pairs]
        sources = [self.row(3, pair, self.width) for pair in pairs]
        alloca: Any = cgutils.alloca_once
        sums = [alloca(builder, target.type.pointee) for target in targets]
        for total, target in zip(sums, targets, strict=True):
            builder.store(builder.load(target, align=_FLOAT_BYTES), total)
        with cgutils.for_range(builder, self.number(self.width)) as loop:
            start = builder.add(self.at, builder.mul(loop.index, self.number(self.wider)))
            weights = builder.load(self.vector(5, start), align=_FLOAT_BYTES)
            for total, source in zip(sums, sources, strict=True):
                self._add(total, builder.add(source, loop.index), weights)
        for total, target in zip(sums, targets, strict=True):
            builder.store(builder.load(total), target, align=_FLOAT_BYTES)

    def _add(self, total: Any, source: Any, weights: Any) -> None:
        builder = self.builder
        feature = builder.load(builder.gep(self.data[2], [source]))
        none = ir.Constant(weights.type, ir.Undefined)
        alone = builder.insert_element(none, feature, ir.Constant(ir.IntType(32), 0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), self.wider), [0] * self.wider)
        everywhere = builder.shuffle_vector(alone, none, mask)
        if self.fused:
            made = builder.call(self._multiply_add(weights.type), [
                everywhere, weights, builder.load(total)
            ])  # fmt: skip
            builder.store(made, total)
            return
        product = builder.fmul(everywhere, weights, flags=_FUSED)
        builder.store(builder.fadd(builder.load(total), product, flags=_FUSED), total)

    def _multiply_add(self, kind: Any) -> Any:
        """LLVM's fused multiplication and addition of vectors."""
        typed = ir.FunctionType(kind, [kind] * 3)
        name = f"llvm.fma.v{self.wider}f32"
        declared: Any = cgutils.get_or_insert_function
        return declared(self.builder.module, typed, name)


def _adder(fused: bool) -> Callable[..., Any]:
    """The typing of the products' code."""

    def typed(
        typing: Any, sums: Any, targets: Any, read: Any, sources: Any, pairs: Any, kernel: Any,
        at: Any, width: Any, wider: Any,
    ) -> Any:  # fmt: skip
        if not all(isinstance(size, types.IntegerLiteral) for size in (width, wider)):
            return None

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            writer = _Writer(context, builder, signature.args, values, fused)
            together = writer.number(_TOGETHER)
            whole = builder.sdiv(writer.pairs, together)
            with cgutils.for_range(builder, whole) as loop:
                writer.block(builder.mul(loop.index, together), _TOGETHER)
            done = builder.mul(whole, together)
            with cgutils.for_range(builder, builder.sub(writer.pairs, done)) as loop:
                writer.block(builder.add(done, loop.index), 1)
            return context.get_dummy_value()

        kinds = (sums, targets, read, sources, types.intp, kernel, types.intp, width, wider)
        return types.void(*kinds), code

    return typed


add_products: Any = intrinsic(_adder(fused=False), prefer_literal=True)
"""``add_products(sums, targets, read, sources, pairs, kernel, at, width, wider)``, unchecked.

For each of the `pairs` first targets, all different, and sources, which are rows of the flat arrays
`sums` and `read`: ``sums[target] += read[source] @ matrix``. The (width, wider) matrix begins at
``kernel[at]``.
"""
add_fused_products: Any = intrinsic(_adder(fused=True), prefer_literal=True)
"""As `add_products`, for any numbers: the same bits on every machine."""

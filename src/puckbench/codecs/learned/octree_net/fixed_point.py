"""Fixed-point arithmetic that floating-point hardware computes exactly.

Weights are multiples of 2**-9 and activations of 2**-5. A layer's sums are then whole multiples of
2**-14; they are kept below 2**24 of them, which single precision holds exactly, so that neither the
order of a sum, nor a fused multiplication, nor the number of threads, nor another library or
processor can change one bit. (An "integer network" in the sense of Ballé, Johnston, Minnen, ICLR
2019, whose integers happen to be stored as floats, for which every machine has fast products.)
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

WEIGHT_UNITS = 2**9
UNITS = 2**5
"""Of activations, of the residual stream and of logits, which are powers of two."""
MOST_WEIGHT = 2**11 - 1
"""In units: such integers are exact in half precision, in which weights are kept."""
MOST_ACTIVATION = 255
MOST_STREAM = 2**11
MOST_SUM = 2**24


class _Rounded(torch.autograd.Function):
    """Multiples of 1 / units; gradients pass as if nothing had been rounded."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, units: int) -> Tensor:
        return (values * units).round_().div_(units)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient, None


def rounded(values: Tensor, units: int = UNITS) -> Tensor:
    """The nearest multiples of 1 / units, halves to even; differentiable as the identity."""
    result: Tensor = _Rounded.apply(values, units)  # type: ignore[no-untyped-call]
    return result


def weight(values: Tensor) -> Tensor:
    """A parameter as the layers use it: a multiple of the weights' unit, within their range."""
    most = MOST_WEIGHT / WEIGHT_UNITS
    return rounded(values.clamp(-most, most), WEIGHT_UNITS)


def streamed(values: Tensor) -> Tensor:
    """Sums as the residual stream carries them on."""
    most = MOST_STREAM / UNITS
    return rounded(values.clamp(-most, most))


def activated(values: Tensor) -> Tensor:
    """What a layer reads of the residual stream: nothing below 0, 8 bits above."""
    return values.clamp(0, MOST_ACTIVATION / UNITS)


def largest_sum(kernel: Tensor, bias: Tensor) -> int:
    """Most units that any partial sum of a layer, added to the stream, can reach.

    kernel: (..., c, d), bias: (d).
    """
    rows = kernel.detach().double().flatten(0, -2).abs().sum(dim=0) * WEIGHT_UNITS
    most = rows * MOST_ACTIVATION + bias.detach().double().abs() * (WEIGHT_UNITS * UNITS)
    return int(most.max()) + MOST_STREAM * WEIGHT_UNITS

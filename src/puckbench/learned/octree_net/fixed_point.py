"""Fixed-point arithmetic that floating-point hardware computes exactly.

Weights are multiples of 2**-9 and activations of 2**-5. The sums of a layer are multiples of 2**-14
and kept below 2**24 of these, which single precision holds exactly, so that neither the order of a
sum, nor a fused multiplication, nor the number of threads, nor the library or processor can change
a bit.

References
----------
Ballé, Johnston, Minnen: "Integer Networks for Data Compression with Latent-Variable Models", ICLR
2019. Here the integers are stored as floats, for which every machine has fast matrix products.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

WEIGHT_UNITS = 2**9
UNITS = 2**5
"""Units of 1 of activations, of the residual stream and of logits."""
MAX_WEIGHT = 2**11 - 1
"""In units: such integers are exact in half precision, in which weights are kept."""
MAX_ACTIVATION = 255
MAX_RESIDUAL = 2**11
MAX_SUM = 2**24


class _StraightThrough(torch.autograd.Function):
    """Rounding to multiples of 1 / units whose gradient is that of the identity."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, units: int) -> Tensor:
        return (values * units).round_().div_(units)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient, None


def quantised(values: Tensor, units: int = UNITS) -> Tensor:
    """The nearest multiples of 1 / units, halves to even; the gradient passes unchanged."""
    result: Tensor = _StraightThrough.apply(values, units)  # type: ignore[no-untyped-call]
    return result


def quantised_weight(values: Tensor) -> Tensor:
    """A parameter as layers use it: clipped, and a multiple of the weights' unit."""
    most = MAX_WEIGHT / WEIGHT_UNITS
    return quantised(values.clamp(-most, most), WEIGHT_UNITS)


def residual(values: Tensor) -> Tensor:
    """Sums as the residual stream carries them on: clipped, and multiples of the unit."""
    most = MAX_RESIDUAL / UNITS
    return quantised(values.clamp(-most, most))


def activation(values: Tensor) -> Tensor:
    """The clipped ReLU, through which layers read the residual stream: 8 bits."""
    return values.clamp(0, MAX_ACTIVATION / UNITS)


def largest_sum(kernel: Tensor, bias: Tensor) -> int:
    """The largest partial sum of a layer and the residual stream, in units of the sums.

    Parameters
    ----------
    kernel
        (..., c, d).
    bias
        (d,).
    """
    rows = kernel.detach().double().flatten(0, -2).abs().sum(dim=0) * WEIGHT_UNITS
    most = rows * MAX_ACTIVATION + bias.detach().double().abs() * (WEIGHT_UNITS * UNITS)
    return int(most.max()) + MAX_RESIDUAL * WEIGHT_UNITS

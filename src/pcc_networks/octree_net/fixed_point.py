"""Fixed-point arithmetic that floating-point hardware computes exactly.

Weights are multiples of 2**-9, activations of 2**-5. A layer's sums, in units of 2**-14, are below
2**24; single precision computes such sums exactly, in any order, on any processor.

References
----------
Ballé et al.: "Integer Networks for Data Compression with Latent-Variable Models", ICLR 2019.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

WEIGHT_UNITS = 2**9
UNITS = 2**5
"""Activations, residual stream and logits are multiples of 1 / UNITS."""
MAX_WEIGHT = 2**11 - 1
"""Maximum weight in units of 1 / WEIGHT_UNITS; half precision stores such weights exactly."""
MAX_ACTIVATION = 255
MAX_RESIDUAL = 2**11
MAX_SUM = 2**24


class _StraightThrough(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, units: int) -> Tensor:
        return (values * units).round_().div_(units)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return gradient, None


def quantised(values: Tensor, units: int = UNITS) -> Tensor:
    """Round to multiples of 1 / units, ties to even; gradients pass unchanged."""
    result: Tensor = _StraightThrough.apply(values, units)  # type: ignore[no-untyped-call]
    return result


def quantised_weight(values: Tensor) -> Tensor:
    bound = MAX_WEIGHT / WEIGHT_UNITS
    return quantised(values.clamp(-bound, bound), WEIGHT_UNITS)


def residual(values: Tensor) -> Tensor:
    """Clip sums and round them to units of the residual stream (the features between layers)."""
    bound = MAX_RESIDUAL / UNITS
    return quantised(values.clamp(-bound, bound))


def activation(values: Tensor) -> Tensor:
    """Apply the clipped ReLU (8-bit results) to the residual stream, before a layer."""
    return values.clamp(0, MAX_ACTIVATION / UNITS)


def largest_sum(kernel: Tensor, bias: Tensor) -> int:
    """Return the largest possible sum of layer output and residual stream, in units of 2**-14."""
    rows = kernel.detach().double().flatten(0, -2).abs().sum(dim=0) * WEIGHT_UNITS
    bound = rows * MAX_ACTIVATION + bias.detach().double().abs() * (WEIGHT_UNITS * UNITS)
    return int(bound.max()) + MAX_RESIDUAL * WEIGHT_UNITS

"""Linear layers in fixed point, whose sums are exact in double precision.

Values are multiples of `STEP`, at most `LIMIT`. All numbers are stored as doubles that are whole:
values in units of `STEP`, weights in units of 2**-bits, and sums in the product of the two. A
layer's bits are so many that no sum exceeds 2**53. Matrix libraries may therefore add in any order
and still return the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pointkit.compiling import compiled, inlined

Floats = NDArray[np.float64]
STEP_BITS, LIMIT_BITS = 16, 10
STEP, LIMIT = 2.0**-STEP_BITS, 2.0**LIMIT_BITS
"""Distance of neighbouring values, and the largest value."""
MOST_STEPS = LIMIT / STEP
_WEIGHT_BITS = 51 - STEP_BITS - LIMIT_BITS
"""Log2 of the sum of a row's weights: 2^51 for products, and as much for the bias."""
_ROUNDER = 1.5 * 2.0**52
"""Adding and then subtracting this number rounds a double to the nearest integer, ties to even."""


class Linear(NamedTuple):
    """A linear layer in fixed point.

    Parameters
    ----------
    matrix
        Weights (inputs, outputs), whole numbers in units of `unit`.
    bias
        Biases (outputs,), whole numbers in units of ``STEP * unit``.
    unit
        A power of two.
    """

    matrix: Tensor
    bias: Tensor
    unit: float


def fixed_linear(weight: Floats, bias: Floats) -> Linear:
    """Round a linear layer to fixed point.

    Parameters
    ----------
    weight
        Weights (outputs, inputs), finite.
    bias
        Biases (outputs,), finite; those beyond `LIMIT` are clipped.
    """
    # correctly rounded sums, which are the same on every machine
    widest = max(math.fsum(row) for row in np.abs(weight).tolist())
    bits = min(_WEIGHT_BITS, _WEIGHT_BITS - math.frexp(widest)[1])
    rounded = np.rint(np.ldexp(weight.T, bits))
    whole_bias = np.rint(np.ldexp(np.clip(bias, -LIMIT, LIMIT), STEP_BITS + bits))
    matrix = torch.from_numpy(np.ascontiguousarray(rounded))
    return Linear(matrix, torch.from_numpy(whole_bias), 2.0**-bits)


def applied(layer: Linear, inputs: Tensor, relu: bool = False) -> Tensor:
    """Apply a layer, and round the result to steps.

    Parameters
    ----------
    layer
        The layer.
    inputs
        Values (rows, inputs) in steps.
    relu
        Whether negative results become 0.

    Returns
    -------
    Tensor
        Values (rows, outputs) in steps, of a new array.
    """
    sums = torch.addmm(layer.bias, inputs, layer.matrix)
    settle(flat(sums), layer.unit, 0.0 if relu else -MOST_STEPS)
    return sums


def flat(tensor: Tensor) -> Floats:
    """Return a contiguous tensor as a flat array that shares its memory."""
    array: Floats = tensor.numpy().reshape(-1)
    return array


@inlined
def clipped(value: float, least: float) -> float:
    """Return a value in steps, at least `least` and at most `LIMIT`."""
    return min(max(value, least), MOST_STEPS)


@inlined
def rounded(value: float) -> float:
    """Return the nearest integer to a number of magnitude below 2**51, ties to even."""
    return (value + _ROUNDER) - _ROUNDER


@compiled
def settle(sums: Floats, unit: float, least: float) -> None:
    """Round sums to steps in place.

    Parameters
    ----------
    sums
        Whole numbers in units of ``STEP * unit``.
    unit
        Unit of the layer's weights.
    least
        Least value in steps.
    """
    for k in range(len(sums)):
        sums[k] = rounded(clipped(sums[k] * unit, least))


@compiled
def add_values(values: Floats, onto: Floats) -> None:
    """Add values in steps to others, in place."""
    for k in range(len(values)):
        onto[k] = clipped(onto[k] + values[k], -MOST_STEPS)

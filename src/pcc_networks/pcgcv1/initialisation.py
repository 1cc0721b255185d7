"""Layer-sequential unit-variance initialisation, without which PCGCv1 does not learn.

PyTorch's initialisation gives the latent a standard deviation of 0.05, far below the noise that
replaces rounding. Therefore each layer's weights in turn are divided by the standard deviation of
the layer's output for an example.

References
----------
Mishkin, Matas: "All you need is a good init", ICLR 2016.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor, nn

from pcc_networks.pcgcv1.model import PCGCv1

_DEVIATIONS = {"conv1_2": 0.3, "conv2_3": 0.3, "g_a.conv_out": 4.0, "h_a.conv3": 3.0,
               "g_s.conv_out": 0.5}  # fmt: skip
"""Standard deviations other than one: of residuals, of values to be rounded, and of logits."""
_EMPTY_PER_OCCUPIED = 3.0
"""Empty voxels per occupied voxel according to the initial logits."""


def initialise(model: PCGCv1, cube_size: int) -> None:
    """Scale a new model's weights so that each layer's output for a sphere has unit variance."""
    with torch.no_grad(), _rescaled(model):
        y = model.g_a(sphere(cube_size))
        model.h_s(model.h_a(y))
        model.g_s(y)
        if model.g_s.conv_out.bias is not None:
            model.g_s.conv_out.bias.fill_(-math.log(_EMPTY_PER_OCCUPIED))


def sphere(size: int) -> Tensor:
    axis = torch.arange(size) - (size - 1) / 2
    radius = (axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2).sqrt()
    return ((radius - 0.4 * size).abs() < 0.5).float()[None, None]


@contextmanager
def _rescaled(model: nn.Module) -> Iterator[None]:
    hooks = [
        layer.register_forward_hook(_rescaler(name))
        for name, layer in model.named_modules()
        if isinstance(layer, (nn.Conv3d, nn.ConvTranspose3d))
    ]
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def _rescaler(name: str) -> Callable[[Any, Any, Tensor], Tensor]:
    deviation = next((d for end, d in _DEVIATIONS.items() if name.endswith(end)), 1.0)

    def rescale(layer: nn.Conv3d, _: Any, output: Tensor) -> Tensor:
        if layer.bias is not None:
            bias = layer.bias[:, None, None, None]
            output = output - bias
            layer.bias.zero_()
        factor = deviation / output.std().clamp_min(1e-6)
        layer.weight.mul_(factor)
        return output * factor

    return rescale

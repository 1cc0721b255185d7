"""First weights with which PCGCv1 learns at all: every layer's answers vary alike.

With PyTorch's own first weights a latent of 0.05 drowns in the noise that stands for rounding,
and the network soon gives one and the same answer everywhere. So each layer's weights are divided
by the standard deviation of what it answers to an example, in the order in which the layers are
passed (Mishkin, Matas: "All you need is a good init", ICLR 2016).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor, nn

from puckbench.codecs.learned.pcgcv1.model import PCGCv1

_SPREADS = {"near_out": 0.3, "point_out": 0.3, "analysis.last": 4.0, "hyper_encoder.last": 3.0,
            "synthesis.last": 0.5}  # fmt: skip
"""Standard deviations other than one: of what is added to a block's input, of what is rounded, and
of the logits."""
_EMPTY = 3.0
"""Empty for one occupied, as the loss weighs them: what the logits say of nothing known."""


def level(model: PCGCv1, side: int) -> None:
    """Change a new model's weights so that all its layers' answers to a sphere vary alike.

    side: of the cube that the sphere is in, in voxels.
    """
    with torch.no_grad(), _levelled(model):
        latent = model.analysis(sphere(side))
        model.hyper_decoder(model.hyper_encoder(latent))
        model.synthesis(latent)
        if model.synthesis.last.bias is not None:
            model.synthesis.last.bias.fill_(-math.log(_EMPTY))


def sphere(side: int) -> Tensor:
    """A sphere's shell in a cube of zeros (1, 1, side, side, side)."""
    axis = torch.arange(side) - (side - 1) / 2
    away = (axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2).sqrt()
    return ((away - 0.4 * side).abs() < 0.5).float()[None, None]


@contextmanager
def _levelled(model: nn.Module) -> Iterator[None]:
    """Within it, each convolution that is passed has its weights changed."""
    hooks = [
        layer.register_forward_hook(_leveller(name))
        for name, layer in model.named_modules()
        if isinstance(layer, (nn.Conv3d, nn.ConvTranspose3d))
    ]
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def _leveller(name: str) -> Callable[[Any, Any, Tensor], Tensor]:
    spread = next((s for end, s in _SPREADS.items() if name.endswith(end)), 1.0)

    def changed(layer: nn.Conv3d, _: Any, answers: Tensor) -> Tensor:
        if layer.bias is not None:
            bias = layer.bias[:, None, None, None]
            answers = answers - bias
            layer.bias.zero_()
        factor = spread / answers.std().clamp_min(1e-6)
        layer.weight.mul_(factor)
        return answers * factor

    return changed

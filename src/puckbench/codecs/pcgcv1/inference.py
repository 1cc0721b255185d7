"""PCGCv1 without gradients, a cube at a time: the same arithmetic, laid out for vector units.

A vector unit computes sixteen output features at once, but most layers at full resolution have four
or eight, or one. Such a layer computes those of several neighbouring voxels together: a kernel of
3 x 3 x (2 + p) voxels, placed at every p-th voxel, has p times the outputs. In channels-last memory
the result is that of the plain layer. One cube is one thread's from beginning to end, so that the
number of threads and of cubes cannot change its result.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, cast

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import conv3d, pad

from puckbench.codecs.pcgcv1.model import Conv, Down, PCGCv1, Up, VoxceptionResNet

_LANES = 16
_TILE = 4
"""The last layer, with its one output, takes tiles of 4 x 4 voxels."""
Floats32 = NDArray[np.float32]
Integers = NDArray[np.int32]


class Inference:
    """The networks of a model, their weights laid out once."""

    def __init__(self, model: PCGCv1) -> None:
        with torch.no_grad():
            self._gains = [model.gain(rate).detach() for rate in range(model.shape.rates)]
            analysis, synthesis, hyper = model.analysis, model.synthesis, model.hyper_encoder
            self._first, self._last = _strips(analysis.first), _strips(analysis.last)
            self._downs = [_plain(cast(Down, down)) for down in analysis.downs]
            self._falling = [_residuals(blocks) for blocks in analysis.blocks]
            self._hyper = (_strips(hyper.first), _plain(hyper.down), _strips(hyper.last))
            self._begin, self._end = _strips(synthesis.first), _tiles(synthesis.last)
            self._ups = [cast(Up, up) for up in synthesis.ups]
            self._rising = [_residuals(blocks) for blocks in synthesis.blocks]

    def analyse(self, occupied: Floats32, rate: int) -> tuple[Integers, Integers]:
        """Voxels (side, side, side) of zeros and ones to latent and hyper-latent, rounded."""
        with torch.inference_mode():
            features = self._first.over(_laid(torch.from_numpy(occupied)[None, None])).relu_()
            features = _through(self._falling[0], features)
            for down, blocks in zip(self._downs, self._falling[1:], strict=True):
                features = _through(blocks, _lowered(features, down).relu_())
            latent = self._last.over(features) * self._gains[rate]
            return _rounded(latent), _rounded(self._hyper_encoded(latent))

    def _hyper_encoded(self, latent: Tensor) -> Tensor:
        first, down, last = self._hyper
        features = first.over(_laid(latent)).relu_()
        return last.over(_lowered(features, down).relu_())

    def synthesise(self, latent: Integers, rate: int) -> Floats32:
        """Latent (c, s, s, s) to a logit for each voxel of the cube, flat, z fastest."""
        with torch.inference_mode():
            features = _laid(torch.from_numpy(latent)[None].float() / self._gains[rate])
            features = _through(self._rising[0], self._begin.over(features).relu_())
            for up, blocks in zip(self._ups, self._rising[1:], strict=True):
                features = _through(blocks, _laid(up(features)).relu_())
            logits: Floats32 = _occupancy(features, self._end).numpy()
        return logits


def _laid(features: Tensor) -> Tensor:
    return features.contiguous(memory_format=torch.channels_last_3d)


def _rounded(features: Tensor) -> Integers:
    whole: Integers = features[0].round().clamp(-(2**15), 2**15 - 1).int().numpy()
    return whole


@dataclass(frozen=True)
class Plain:
    """Kernel and bias of a convolution."""

    kernel: Tensor
    bias: Tensor | None


def _plain(layer: nn.Conv3d) -> Plain:
    bias = None if layer.bias is None else layer.bias.detach()
    return Plain(_laid(layer.weight.detach()), bias)


def _lowered(features: Tensor, layer: Plain) -> Tensor:
    return _convolution(_laid(pad(features, (0, 1) * 3)), layer, [2, 2, 2], 0)


def _convolution(features: Tensor, layer: Plain, stride: list[int], padding: int) -> Tensor:
    """conv3d by oneDNN where there is one; PyTorch would take a slow way for a single image."""
    if not torch.backends.mkldnn.is_available():
        return conv3d(features, layer.kernel, layer.bias, stride, padding)
    around, apart = [padding] * 3, [1, 1, 1]
    return torch.mkldnn_convolution(
        features, layer.kernel, layer.bias, around, stride, apart, groups=1
    )


@dataclass(frozen=True)
class Strips:
    """A 3x3x3 convolution that computes `together` neighbours along z at once."""

    layer: Plain
    out: int
    together: int

    def over(self, features: Tensor) -> Tensor:
        """One cube (1, c, s, s, s), in channels-last memory, to (1, d, s, s, s) in the same."""
        side = features.shape[-1]
        strips = _laid(_convolution(features, self.layer, [1, 1, self.together], 1))
        flat = strips.permute(0, 2, 3, 4, 1).reshape(1, side, side, side, self.out)
        return flat.permute(0, 4, 1, 2, 3)


def _strips(layer: Conv) -> Strips:
    together = max(1, _LANES // layer.out_channels)
    kernel = side_by_side(layer.weight.detach(), together, axis=4)
    bias = cast(Tensor, layer.bias).detach().repeat(together)
    return Strips(Plain(_laid(kernel), bias), layer.out_channels, together)


def side_by_side(kernel: Tensor, together: int, axis: int) -> Tensor:
    """Kernels of `together` neighbours along an axis in one, neighbour by neighbour."""
    before, after = [0, 0] * (4 - axis), [0, 0] * (axis - 2)
    moved = [pad(kernel, (*before, k, together - 1 - k, *after)) for k in range(together)]
    return torch.cat(moved)


def _tiles(layer: Conv) -> Plain:
    kernel = side_by_side(layer.weight.detach(), _TILE, axis=4)
    bias = cast(Tensor, layer.bias).detach().repeat(_TILE**2)
    return Plain(_laid(side_by_side(kernel, _TILE, axis=3)), bias)


def _occupancy(features: Tensor, layer: Plain) -> Tensor:
    """The one output of each voxel, (side ** 3), z fastest."""
    side, tiles = features.shape[-1], features.shape[-1] // _TILE
    found = _convolution(features, layer, [1, _TILE, _TILE], 1)[0]
    split = found.reshape(_TILE, _TILE, side, tiles, tiles)
    return split.permute(2, 3, 0, 4, 1).reshape(-1)


@dataclass(frozen=True)
class Residual:
    """A Voxception-ResNet block; its 1x1x1 layers as matrices (in, out) and biases."""

    near_in: Strips
    near_out: Strips
    middle: Strips
    point_in: tuple[Tensor, Tensor]
    point_out: tuple[Tensor, Tensor]


def _residuals(blocks: nn.Module) -> list[Residual]:
    return [_residual(block) for block in cast(Iterable[VoxceptionResNet], blocks)]


def _residual(block: VoxceptionResNet) -> Residual:
    return Residual(
        _strips(block.near_in),
        _strips(block.near_out),
        _strips(block.middle),
        _matrix(block.point_in),
        _matrix(block.point_out),
    )


def _matrix(layer: Conv) -> tuple[Tensor, Tensor]:
    kernel = layer.weight.detach()[:, :, 0, 0, 0].T.contiguous()
    return kernel, cast(Tensor, layer.bias).detach()


def _through(blocks: list[Residual], features: Tensor) -> Tensor:
    """Blocks one after the other; `features` is overwritten."""
    features = _laid(features)
    rows = _rows(features)
    for block in blocks:
        near = block.near_out.over(block.near_in.over(features).relu_())
        matrix, bias = block.point_in
        point = torch.addmm(bias, rows, matrix).relu_()
        point = point.view(1, *features.shape[2:], -1).permute(0, 4, 1, 2, 3)
        point = block.middle.over(point)
        matrix, bias = block.point_out
        _join(*_arrays(rows, _rows(near), _rows(point), matrix, bias))
    return features


def _rows(features: Tensor) -> Tensor:
    """A view of a cube as (voxels, features)."""
    return features.permute(0, 2, 3, 4, 1).view(-1, features.shape[1])


def _arrays(*tensors: Tensor) -> list[NDArray[Any]]:
    return [tensor.numpy() for tensor in tensors]


@numba.njit(cache=True, nogil=True)
def _join(
    rows: Floats32, near: Floats32, point: Floats32, matrix: Floats32, bias: Floats32
) -> None:
    """rows = relu(rows + [relu(near), relu(relu(point) @ matrix + bias)]), in place."""
    half, quarter = near.shape[1], point.shape[1]
    sums = np.empty(half, dtype=np.float32)
    for row in range(len(rows)):
        for k in range(half):
            sums[k] = bias[k]
        for j in range(quarter):
            value = max(point[row, j], np.float32(0))
            for k in range(half):
                sums[k] += value * matrix[j, k]
        for k in range(half):
            rows[row, k] = max(rows[row, k] + max(near[row, k], np.float32(0)), np.float32(0))
            tail = rows[row, half + k] + max(sums[k], np.float32(0))
            rows[row, half + k] = max(tail, np.float32(0))

"""PCGCv1 without gradients, a cube at a time: the same arithmetic, laid out for vector units.

A vector unit computes sixteen output features at once, but most layers at full resolution have four
or eight, or one. Such a layer computes those of several neighbouring voxels together: a kernel of
3 x 3 x (2 + p) voxels, placed at every p-th voxel, has p times the outputs. In channels-last memory
the result is that of the plain layer. One cube is one thread's from beginning to end, so that the
number of threads and of cubes cannot change its result.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import conv3d, pad

from puckbench.codecs.pcgcv1.model import (
    Analysis,
    Conv,
    Down,
    HyperEncoder,
    PCGCv1,
    Synthesis,
    Up,
    VoxceptionResNet,
)

_LANES = 16
Floats32 = NDArray[np.float32]


def analyse(model: PCGCv1, occupied: Floats32, rate: int) -> tuple[NDArray[np.int32], ...]:
    """Voxels (side, side, side) of zeros and ones to latent (c, ...) and hyper-latent, rounded."""
    with torch.inference_mode():
        latent = _analysis(model.analysis, _laid(torch.from_numpy(occupied)[None, None]))
        latent = latent * model.gain(rate)
        hyper = _hyper(model.hyper_encoder, latent.round())
        return _rounded(latent), _rounded(hyper)


def synthesise(model: PCGCv1, latent: NDArray[np.int32], rate: int) -> Floats32:
    """Latent (c, s, s, s) to a logit for each voxel of the cube, flat, z fastest."""
    with torch.inference_mode():
        features = torch.from_numpy(latent)[None].float() / model.gain(rate)
        logits: Floats32 = _synthesis(model.synthesis, _laid(features)).numpy()
    return logits


def _laid(features: Tensor) -> Tensor:
    return features.contiguous(memory_format=torch.channels_last_3d)


def _rounded(features: Tensor) -> NDArray[np.int32]:
    whole: NDArray[np.int32] = features[0].round().clamp(-(2**15), 2**15 - 1).int().numpy()
    return whole


def _analysis(part: Analysis, occupied: Tensor) -> Tensor:
    features = _residuals(convolved(occupied, part.first).relu_(), _sequence(part.blocks[0]))
    for down, blocks in zip(part.downs, part.blocks[1:], strict=True):
        features = _lowered(features, cast(Down, down)).relu_()
        features = _residuals(features, _sequence(blocks))
    return convolved(features, part.last)


def _synthesis(part: Synthesis, latent: Tensor) -> Tensor:
    features = _residuals(convolved(latent, part.first).relu_(), _sequence(part.blocks[0]))
    for up, blocks in zip(part.ups, part.blocks[1:], strict=True):
        features = _laid(cast(Up, up)(features)).relu_()
        features = _residuals(features, _sequence(blocks))
    return occupancy(features, part.last)


def _hyper(part: HyperEncoder, latent: Tensor) -> Tensor:
    features = convolved(_laid(latent), part.first).relu_()
    return convolved(_lowered(features, part.down).relu_(), part.last)


def _sequence(blocks: torch.nn.Module) -> Iterable[VoxceptionResNet]:
    return cast(Iterable[VoxceptionResNet], blocks)


def _convolution(features: Tensor, kernel: Tensor, bias: Tensor | None, stride: list[int],
                 padding: int) -> Tensor:  # fmt: skip
    """conv3d by oneDNN where there is one; PyTorch would take a slow way for a single image."""
    if not torch.backends.mkldnn.is_available():
        return conv3d(features, kernel, bias, stride, padding)
    return torch.mkldnn_convolution(features, kernel, bias, [padding] * 3, stride, [1, 1, 1], 1)


def convolved(features: Tensor, layer: Conv) -> Tensor:
    """A 3x3x3 convolution of one cube (1, c, s, s, s), in channels-last memory."""
    out, side = layer.out_channels, features.shape[-1]
    together = max(1, _LANES // out)
    kernel = _side_by_side(layer.weight, together, axis=4)
    bias = cast(Tensor, layer.bias).repeat(together)
    strips = _laid(_convolution(features, _laid(kernel), bias, [1, 1, together], 1))
    flat = strips.permute(0, 2, 3, 4, 1).reshape(1, side, side, side, out)
    return flat.permute(0, 4, 1, 2, 3)


def _side_by_side(kernel: Tensor, together: int, axis: int) -> Tensor:
    """Kernels of `together` neighbours along an axis in one, neighbour by neighbour."""
    before, after = [0, 0] * (4 - axis), [0, 0] * (axis - 2)
    moved = [pad(kernel, (*before, k, together - 1 - k, *after)) for k in range(together)]
    return torch.cat(moved)


def occupancy(features: Tensor, layer: Conv) -> Tensor:
    """The layer with one output, sixteen voxels of a plane together: (side ** 3), z fastest."""
    side, four = features.shape[-1], 4
    kernel = _side_by_side(_side_by_side(layer.weight, four, axis=4), four, axis=3)
    bias = cast(Tensor, layer.bias).repeat(four * four)
    tiles = _convolution(features, _laid(kernel), bias, [1, four, four], 1)[0]
    split = tiles.reshape(four, four, side, side // four, side // four)
    return split.permute(2, 3, 0, 4, 1).reshape(-1)


def _lowered(features: Tensor, layer: Down) -> Tensor:
    padded = _laid(pad(features, (0, 1) * 3))
    return _convolution(padded, _laid(layer.weight), layer.bias, [2, 2, 2], 0)


def _residuals(features: Tensor, blocks: Iterable[VoxceptionResNet]) -> Tensor:
    """Blocks one after the other; `features` is overwritten."""
    features = _laid(features)
    rows = _rows(features)
    for block in blocks:
        near = convolved(convolved(features, block.near_in).relu_(), block.near_out)
        point = torch.addmm(cast(Tensor, block.point_in.bias), rows, _matrix(block.point_in))
        shape = (1, *features.shape[2:], point.shape[1])
        point = convolved(point.relu_().view(shape).permute(0, 4, 1, 2, 3), block.middle)
        out = block.point_out
        _join(rows.numpy(), _rows(near).numpy(), _rows(point).numpy(), _matrix(out).numpy(),
              cast(Tensor, out.bias).numpy())  # fmt: skip
    return features


def _rows(features: Tensor) -> Tensor:
    """A view of a cube as (voxels, features)."""
    return features.permute(0, 2, 3, 4, 1).view(-1, features.shape[1])


def _matrix(layer: Conv) -> Tensor:
    return layer.weight[:, :, 0, 0, 0].T.contiguous()


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

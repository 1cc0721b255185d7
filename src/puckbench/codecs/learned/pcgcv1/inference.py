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
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import conv3d, max_pool3d, pad

from puckbench.codecs.learned.pcgcv1.model import (
    Conv,
    Down,
    PCGCv1,
    Pointwise,
    Up,
    VoxceptionResNet,
    held,
)

_LANES = 16
_TILE = 4
"""Most voxels taken together along an axis; the layer with one output takes 4 x 4 of them."""
_ROWS = 16384
"""Voxels of a chunk that stays in the cache while a block is finished."""
_REACH = 16
"""Margin around the voxels of a cube. Seven layers of three spread what they see seven voxels far,
and let as much of a false border in: `_UNSURE` of the margin is thrown away."""
_UNSURE = 8
_GRAIN = 16
"""Sides of the part of a cube that is computed are multiples of it: oneDNN keeps a program, and
megabytes of memory, for each layer and each shape that it has seen."""
Floats32 = NDArray[np.float32]
Integers = NDArray[np.int32]


class Inference:
    """The networks of a model, their weights laid out once."""

    def __init__(self, model: PCGCv1) -> None:
        with torch.no_grad():
            self._empties: dict[tuple[int, ...], Tensor] = {}
            self._shape = model.shape
            self._gains = [model.gain(rate).detach() for rate in range(model.shape.rates)]
            analysis, synthesis, hyper = model.analysis, model.synthesis, model.hyper_encoder
            self._first, self._last = _strips(analysis.first), _strips(analysis.last)
            self._downs = [_plain(cast(Down, down)) for down in analysis.downs]
            self._falling = [_residuals(blocks) for blocks in analysis.blocks]
            self._hyper = (_strips(hyper.first), _plain(hyper.down), _strips(hyper.last))
            self._begin, self._end = _strips(synthesis.first), _tiles(synthesis.last)
            self._ups = [_parities(cast(Up, up)) for up in synthesis.ups]
            self._rising = [_residuals(blocks) for blocks in synthesis.blocks]

    def analyse(self, occupied: Floats32, rate: int) -> tuple[Integers, Integers]:
        """Voxels (side, side, side) of zeros and ones to latent and hyper-latent, rounded."""
        with torch.inference_mode():
            features = _through(self._falling[1], self._halved(occupied))
            features = _through(self._falling[2], _lowered(features, self._downs[1]).relu_())
            blocks = held(self._shape, torch.from_numpy(occupied)[None, None])
            latent = self._last.over(features) * self._gains[rate] * blocks
            hyper = self._hyper_encoded(latent) * max_pool3d(blocks, 2)
            return _rounded(latent), _rounded(hyper)

    def _halved(self, occupied: Floats32) -> Tensor:
        """Features at stride 2; beyond the reach of any voxel they are an empty cube's."""
        sides = occupied.shape
        box = _box(occupied)
        part = self._halved_whole(occupied[tuple(slice(low, high) for low, high in box)])
        kept = [
            ((low + _UNSURE) // 2 if low else 0, (high - _UNSURE if high < side else high) // 2)
            for (low, high), side in zip(box, sides, strict=True)
        ]
        whole = self._empty(sides).clone(memory_format=torch.channels_last_3d)
        there = tuple(slice(low, high) for low, high in kept)
        here = tuple(
            slice(low - first // 2, high - first // 2)
            for (low, high), (first, _) in zip(kept, box, strict=True)
        )
        whole[0][(slice(None), *there)] = part[0][(slice(None), *here)]
        return whole

    def _empty(self, sides: tuple[int, ...]) -> Tensor:
        if sides not in self._empties:
            self._empties[sides] = self._halved_whole(np.zeros(sides, dtype=np.float32))
        return self._empties[sides]

    def _halved_whole(self, occupied: Floats32) -> Tensor:
        voxels = _laid(torch.from_numpy(np.ascontiguousarray(occupied))[None, None])
        features = _through(self._falling[0], self._first.over(voxels).relu_())
        return _laid(_lowered(features, self._downs[0]).relu_())

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
                features = _through(blocks, up.over(features))
            logits: Floats32 = _occupancy(features, self._end).numpy()
        return logits


def _box(occupied: Floats32) -> list[tuple[int, int]]:
    """First and last of the voxels along each axis, with a margin, at multiples of `_GRAIN`."""
    box = []
    for axis, side in enumerate(occupied.shape):
        others = tuple(other for other in range(3) if other != axis)
        found = np.flatnonzero(occupied.any(axis=others))
        low, high = (found[0], found[-1] + 1) if len(found) else (0, side)
        last = -(-(int(high) + _REACH) // _GRAIN) * _GRAIN
        box.append((max(int(low) - _REACH, 0) // _GRAIN * _GRAIN, min(last, side)))
    return box


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
    if not torch.backends.mkldnn.is_available():  # type: ignore[no-untyped-call]
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
        sides = features.shape[2:]
        strips = _laid(_convolution(features, self.layer, [1, 1, self.together], 1))
        flat = strips.permute(0, 2, 3, 4, 1).reshape(1, *sides, self.out)
        return flat.permute(0, 4, 1, 2, 3)


def _strips(layer: Conv) -> Strips:
    together = max(1, min(_TILE, _LANES // layer.out_channels))
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
class Parities:
    """A transposed convolution and its ReLU, by the parity of x and y; both of z at once.

    An even output has two inputs along an axis, an odd one one, so that four small kernels do
    what one large kernel would do with every other product a zero.
    """

    layers: tuple[tuple[Plain, Plain], tuple[Plain, Plain]]
    out: int

    def over(self, features: Tensor) -> Tensor:
        """One cube (1, c, s, s, s) to (1, d, 2 s, 2 s, 2 s), in channels-last memory."""
        side = features.shape[-1]
        padded = _laid(pad(features, (1, 0) * 3))
        raised = torch.empty(side, 2, side, 2, 2 * side * self.out)
        for x, row in enumerate(self.layers):
            for y, layer in enumerate(row):
                found = _laid(_convolution(padded[:, :, x:, y:], layer, [1, 1, 1], 0))
                strips = found.permute(0, 2, 3, 4, 1).reshape(side, side, -1)
                torch.clamp_min(strips, 0, out=raised[:, x, :, y])
        cube = raised.view(1, 2 * side, 2 * side, 2 * side, self.out)
        return cube.permute(0, 4, 1, 2, 3)


def _parities(layer: Up) -> Parities:
    kernel = layer.weight.detach().transpose(0, 1)
    bias = cast(Tensor, layer.bias).detach().repeat(2)

    def one(x: int, y: int) -> Plain:
        part = _taps(_taps(kernel, x, axis=2), y, axis=3)
        even, odd = _taps(part, 0, axis=4), pad(_taps(part, 1, axis=4), (1, 0))
        return Plain(_laid(torch.cat([even, odd])), bias)

    return Parities(((one(0, 0), one(0, 1)), (one(1, 0), one(1, 1))), layer.out_channels)


def _taps(kernel: Tensor, parity: int, axis: int) -> Tensor:
    """What outputs of a parity use of a kernel of three: of the input before and of their own."""
    taps = torch.tensor([1] if parity else [2, 0])
    return kernel.index_select(axis, taps)


@dataclass(frozen=True)
class Points:
    """A 1x1x1 convolution as a matrix that serves several voxels at once, and its bias."""

    matrix: Tensor
    bias: Tensor
    together: int

    def over(self, rows: Tensor) -> Tensor:
        """(n, c) to (n, d); n is a multiple of the voxels taken together."""
        wide = torch.addmm(self.bias, rows.reshape(len(rows) // self.together, -1), self.matrix)
        return wide.view(len(rows), -1)


def _points(layer: Pointwise) -> Points:
    together = max(1, _LANES // min(layer.out_channels, layer.in_channels))
    matrix = layer.weight.detach()[:, :, 0, 0, 0].T.contiguous()
    bias = cast(Tensor, layer.bias).detach().repeat(together)
    blocks = torch.block_diag(*[matrix] * together)  # type: ignore[no-untyped-call]
    return Points(blocks, bias, together)


@dataclass(frozen=True)
class Residual:
    """A Voxception-ResNet block."""

    near_in: Strips
    near_out: Strips
    point_in: Points
    middle: Strips
    point_out: Points


def _residuals(blocks: nn.Module) -> list[Residual]:
    return [_residual(block) for block in cast(Iterable[VoxceptionResNet], blocks)]


def _residual(block: VoxceptionResNet) -> Residual:
    return Residual(
        _strips(block.near_in),
        _strips(block.near_out),
        _points(block.point_in),
        _strips(block.middle),
        _points(block.point_out),
    )


def _through(blocks: list[Residual], features: Tensor) -> Tensor:
    """Blocks one after the other; `features` is overwritten."""
    features = _laid(features)
    rows = _rows(features)
    for block in blocks:
        near = block.near_out.over(block.near_in.over(features).relu_())
        point = block.point_in.over(rows).relu_().view(1, *features.shape[2:], -1)
        point = block.middle.over(point.permute(0, 4, 1, 2, 3))
        for first in range(0, len(rows), _ROWS):
            chunk = slice(first, first + _ROWS)
            _join(rows[chunk], _rows(near)[chunk], _rows(point)[chunk], block.point_out)
    return features


def _join(rows: Tensor, near: Tensor, point: Tensor, out: Points) -> None:
    """rows = relu(rows + [relu(near), relu(point_out(relu(point)))]), in place."""
    half = near.shape[1]
    rows[:, :half] += near.relu_()
    rows[:, half:] += out.over(point.relu_()).relu_()
    rows.relu_()


def _rows(features: Tensor) -> Tensor:
    """A view of a cube as (voxels, features)."""
    return features.permute(0, 2, 3, 4, 1).view(-1, features.shape[1])

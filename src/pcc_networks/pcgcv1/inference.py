"""Inference of PCGCv1, arranged for vector units; each thread computes one cube at a time.

A vector unit computes sixteen output channels at once. Layers with fewer channels compute p
adjacent voxels jointly, by a kernel of 3x3x(2 + p) voxels with stride p and p times the channels.
Training and GPUs use the layers in `model` instead. On a CPU these take four times as long; since
they round sums in another order, they would decode other points from the same stream.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import conv3d, max_pool3d, pad

from pcc_networks.pcgcv1.cubes import STRIDE, Bools
from pcc_networks.pcgcv1.model import (
    Conv,
    PCGCv1,
    PointwiseConv,
    StridedConv,
    TransposedConv,
    VoxceptionResNet,
    coded_blocks,
)
from pcc_networks.weights_file import device_of

_LANES = 16
_TILE = 4
"""Maximum voxels computed jointly along an axis; the layer with one channel computes 4x4 voxels."""
_CHUNK_ROWS = 16384
"""Voxels of a chunk that stays in the cache while the last layers of a block are applied."""
_MARGIN = 16
"""Margin, in voxels, around occupied voxels in the computed part of a cube. Seven 3x3x3 layers
reach seven voxels; therefore features within `_INVALID_MARGIN` of the part's borders inside the
cube are wrong and are discarded."""
_INVALID_MARGIN = 8
_SYNTHESIS_MARGIN = 8
"""Margin, in voxels, around the blocks whose logits are needed: seven for the layers, and one where
a transposed convolution lacks the previous input."""
_SIDE_MULTIPLE = 16
"""Sides of the computed part are multiples of this number, since oneDNN keeps a program and
megabytes of memory for each layer and shape."""
Floats32 = NDArray[np.float32]
Integers = NDArray[np.int32]


class CpuTransforms:
    """The transforms g_a, g_s and h_a on a CPU, for one cube at a time."""

    def __init__(self, model: PCGCv1) -> None:
        with torch.no_grad():
            self._empty_features: dict[tuple[int, ...], Tensor] = {}
            self._shape = model.shape
            self._gains = [model.gain(rate).detach() for rate in range(model.shape.rates)]
            g_a, g_s, h_a = model.g_a, model.g_s, model.h_a
            self._conv_in, self._conv_out = _strip_conv(g_a.conv_in), _strip_conv(g_a.conv_out)
            self._downs = [_kernel(cast(StridedConv, down)) for down in g_a.downs]
            self._analysis_blocks = [_residual_blocks(blocks) for blocks in g_a.blocks]
            self._hyper_layers = _strip_conv(h_a.conv1), _kernel(h_a.conv2), _strip_conv(h_a.conv3)
            self._synthesis_in = _strip_conv(g_s.conv_in)
            self._synthesis_out = _tile_kernel(g_s.conv_out)
            self._ups = [_polyphase_conv(cast(TransposedConv, up)) for up in g_s.ups]
            self._synthesis_blocks = [_residual_blocks(blocks) for blocks in g_s.blocks]

    def analyse(self, occupied: Floats32, rate: int) -> tuple[Integers, Integers]:
        """Compute the quantised latents of a cube.

        Parameters
        ----------
        occupied
            Occupancy (side, side, side), 0 or 1.
        rate
            Index of the rate.

        Returns
        -------
        y_hat, z_hat
            Latent and hyper-latent, integers (channels, s, s, s).
        """
        with torch.inference_mode():
            features = _apply_blocks(self._analysis_blocks[1], self._stride_two(occupied))
            features = _apply_blocks(
                self._analysis_blocks[2], _strided_conv(features, self._downs[1]).relu_()
            )
            blocks = coded_blocks(self._shape, torch.from_numpy(occupied)[None, None])
            y = self._conv_out.apply(features) * self._gains[rate] * blocks
            z = self._h_a(y) * max_pool3d(blocks, 2)
            return quantised(y), quantised(z)

    def _stride_two(self, occupied: Floats32) -> Tensor:
        """Return features at stride 2; far from occupied voxels, copy those of an empty cube."""
        sides = occupied.shape
        box = _bounding_box(occupied, _MARGIN, _SIDE_MULTIPLE)
        part = self._stride_two_dense(occupied[tuple(slice(low, high) for low, high in box)])
        features = self._stride_two_empty(sides).clone(memory_format=torch.channels_last_3d)
        target, source = [], []
        for (low, high), side in zip(box, sides, strict=True):
            first = (low + _INVALID_MARGIN) // 2 if low else 0
            last = (high - _INVALID_MARGIN if high < side else high) // 2
            target.append(slice(first, last))
            source.append(slice(first - low // 2, last - low // 2))
        features[0][(slice(None), *target)] = part[0][(slice(None), *source)]
        return features

    def _stride_two_empty(self, sides: tuple[int, ...]) -> Tensor:
        if sides not in self._empty_features:
            self._empty_features[sides] = self._stride_two_dense(np.zeros(sides, dtype=np.float32))
        return self._empty_features[sides]

    def _stride_two_dense(self, occupied: Floats32) -> Tensor:
        voxels = _channels_last(torch.from_numpy(np.ascontiguousarray(occupied))[None, None])
        features = _apply_blocks(self._analysis_blocks[0], self._conv_in.apply(voxels).relu_())
        return _channels_last(_strided_conv(features, self._downs[0]).relu_())

    def _h_a(self, y: Tensor) -> Tensor:
        first, down, last = self._hyper_layers
        features = first.apply(_channels_last(y)).relu_()
        return last.apply(_strided_conv(features, down).relu_())

    def synthesise(self, y_hat: Integers, rate: int, blocks: Bools) -> Floats32:
        """Compute the occupancy of a cube from its latent.

        Parameters
        ----------
        y_hat
            Latent (channels, s, s, s).
        rate
            Index of the rate.
        blocks
            Mask (s, s, s) of the blocks whose voxels are needed.

        Returns
        -------
        ndarray
            Logits (side**3,) of all voxels, z fastest. Outside `blocks` they may be -inf.
        """
        side = blocks.shape[0] * STRIDE
        box = _bounding_box(blocks, _SYNTHESIS_MARGIN // STRIDE, _SIDE_MULTIPLE // STRIDE)
        target = tuple(slice(STRIDE * low, STRIDE * high) for low, high in box)
        (up_to_2, up_to_1), (blocks_4, blocks_2, blocks_1) = self._ups, self._synthesis_blocks
        with torch.inference_mode():
            features = _channels_last(torch.from_numpy(y_hat)[None].float() / self._gains[rate])
            features = _apply_blocks(blocks_4, self._synthesis_in.apply(features).relu_())
            features = _apply_blocks(blocks_2, up_to_2.apply(features))
            x, y, z = (slice(axis.start // 2, axis.stop // 2) for axis in target)
            part = features[:, :, x, y, z]
            features = _apply_blocks(blocks_1, up_to_1.apply(part))
            part_logits = _logits(features, self._synthesis_out).numpy()
        logits = np.full((side, side, side), -np.inf, dtype=np.float32)
        logits[target] = part_logits
        return logits.ravel()


def _bounding_box(occupied: Floats32 | Bools, margin: int, multiple: int) -> list[tuple[int, int]]:
    box = []
    for axis, side in enumerate(occupied.shape):
        others = tuple(other for other in range(3) if other != axis)
        rows = np.flatnonzero(occupied.any(axis=others))
        low, high = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, side)
        last = -(-(high + margin) // multiple) * multiple
        box.append((max(low - margin, 0) // multiple * multiple, min(last, side)))
    return box


def _channels_last(features: Tensor) -> Tensor:
    return features.contiguous(memory_format=torch.channels_last_3d)


def quantised(features: Tensor) -> Integers:
    """Round features (1, c, s, s, s) to 16-bit integers (c, s, s, s)."""
    integers: Integers = features[0].round().clamp(-(2**15), 2**15 - 1).int().numpy()
    return integers


@dataclass(frozen=True)
class ConvolutionKernel:
    """The kernel and the bias of a convolution."""

    kernel: Tensor
    bias: Tensor | None


def _kernel(layer: nn.Conv3d) -> ConvolutionKernel:
    bias = None if layer.bias is None else layer.bias.detach()
    return ConvolutionKernel(_channels_last(layer.weight.detach()), bias)


def _strided_conv(features: Tensor, layer: ConvolutionKernel) -> Tensor:
    return _conv3d(_channels_last(pad(features, (0, 1) * 3)), layer, [2, 2, 2], 0)


def _conv3d(features: Tensor, layer: ConvolutionKernel, stride: list[int], padding: int) -> Tensor:
    # PyTorch's own choice for one image is slower than oneDNN.
    if not torch.backends.mkldnn.is_available():  # type: ignore[no-untyped-call]
        return conv3d(features, layer.kernel, layer.bias, stride, padding)
    paddings, dilation = [padding] * 3, [1, 1, 1]
    return torch.mkldnn_convolution(
        features, layer.kernel, layer.bias, paddings, stride, dilation, groups=1
    )


@dataclass(frozen=True)
class StripConv:
    """A 3x3x3 convolution that computes several voxels along z jointly."""

    layer: ConvolutionKernel
    out: int
    voxels: int

    def apply(self, features: Tensor) -> Tensor:
        sides = features.shape[2:]
        strips = _channels_last(_conv3d(features, self.layer, [1, 1, self.voxels], 1))
        flat = strips.permute(0, 2, 3, 4, 1).reshape(1, *sides, self.out)
        return flat.permute(0, 4, 1, 2, 3)


def _strip_conv(layer: Conv) -> StripConv:
    voxels = max(1, min(_TILE, _LANES // layer.out_channels))
    kernel = joint_kernel(layer.weight.detach(), voxels, axis=4)
    bias = cast(Tensor, layer.bias).detach().repeat(voxels)
    return StripConv(ConvolutionKernel(_channels_last(kernel), bias), layer.out_channels, voxels)


def joint_kernel(kernel: Tensor, voxels: int, axis: int) -> Tensor:
    """Return a kernel that computes several adjacent voxels along an axis jointly."""
    before, after = [0, 0] * (4 - axis), [0, 0] * (axis - 2)
    shifted = [pad(kernel, (*before, k, voxels - 1 - k, *after)) for k in range(voxels)]
    return torch.cat(shifted)


def _tile_kernel(layer: Conv) -> ConvolutionKernel:
    kernel = joint_kernel(layer.weight.detach(), _TILE, axis=4)
    bias = cast(Tensor, layer.bias).detach().repeat(_TILE**2)
    return ConvolutionKernel(_channels_last(joint_kernel(kernel, _TILE, axis=3)), bias)


def _logits(features: Tensor, layer: ConvolutionKernel) -> Tensor:
    sides = features.shape[2:]
    tiles = _conv3d(features, layer, [1, _TILE, _TILE], 1)[0]
    split = tiles.reshape(_TILE, _TILE, *tiles.shape[1:])
    return split.permute(2, 3, 0, 4, 1).reshape(sides)


@dataclass(frozen=True)
class PolyphaseConv:
    """A transposed convolution and its ReLU, computed separately for even and odd x and y.

    The four smaller kernels avoid products with zeros. Even and odd z are computed jointly.
    """

    layers: list[list[ConvolutionKernel]]  # by the parity of x, then of y
    out: int

    def apply(self, features: Tensor) -> Tensor:
        a, b, c = features.shape[2:]
        padded = _channels_last(pad(features, (1, 0) * 3))
        upsampled = torch.empty(a, 2, b, 2, 2 * c * self.out)
        for x, row in enumerate(self.layers):
            for y, layer in enumerate(row):
                phase = _channels_last(_conv3d(padded[:, :, x:, y:], layer, [1, 1, 1], 0))
                strips = phase.permute(0, 2, 3, 4, 1).reshape(a, b, -1)
                torch.clamp_min(strips, 0, out=upsampled[:, x, :, y])
        return upsampled.view(1, 2 * a, 2 * b, 2 * c, self.out).permute(0, 4, 1, 2, 3)


def _polyphase_conv(layer: TransposedConv) -> PolyphaseConv:
    kernel = layer.weight.detach().transpose(0, 1)
    bias = cast(Tensor, layer.bias).detach().repeat(2)

    def part_kernel(x: int, y: int) -> ConvolutionKernel:
        part = _taps(_taps(kernel, x, axis=2), y, axis=3)
        even, odd = _taps(part, 0, axis=4), pad(_taps(part, 1, axis=4), (1, 0))
        return ConvolutionKernel(_channels_last(torch.cat([even, odd])), bias)

    layers = [[part_kernel(x, y) for y in (0, 1)] for x in (0, 1)]
    return PolyphaseConv(layers, layer.out_channels)


def _taps(kernel: Tensor, parity: int, axis: int) -> Tensor:
    taps = torch.tensor([1] if parity else [2, 0])
    return kernel.index_select(axis, taps)


@dataclass(frozen=True)
class MatrixConv:
    """A 1x1x1 convolution that multiplies several voxels jointly by a block-diagonal matrix."""

    matrix: Tensor
    bias: Tensor
    voxels: int

    def apply(self, rows: Tensor) -> Tensor:
        wide = torch.addmm(self.bias, rows.reshape(len(rows) // self.voxels, -1), self.matrix)
        return wide.view(len(rows), -1)


def _matrix_conv(layer: PointwiseConv) -> MatrixConv:
    voxels = max(1, _LANES // min(layer.out_channels, layer.in_channels))
    matrix = layer.weight.detach()[:, :, 0, 0, 0].T.contiguous()
    bias = cast(Tensor, layer.bias).detach().repeat(voxels)
    blocks = torch.block_diag(*[matrix] * voxels)  # type: ignore[no-untyped-call]
    return MatrixConv(blocks, bias, voxels)


class InferenceVoxceptionResNet(NamedTuple):
    """A Voxception-ResNet block whose layers are arranged for inference."""

    conv1_1: StripConv
    conv1_2: StripConv
    conv2_1: MatrixConv
    conv2_2: StripConv
    conv2_3: MatrixConv


def _residual_blocks(blocks: nn.Module) -> list[InferenceVoxceptionResNet]:
    return [
        InferenceVoxceptionResNet(
            _strip_conv(block.conv1_1),
            _strip_conv(block.conv1_2),
            _matrix_conv(block.conv2_1),
            _strip_conv(block.conv2_2),
            _matrix_conv(block.conv2_3),
        )
        for block in cast(Iterable[VoxceptionResNet], blocks)
    ]


def _apply_blocks(blocks: list[InferenceVoxceptionResNet], features: Tensor) -> Tensor:
    features = _channels_last(features)
    rows = _rows(features)
    for block in blocks:
        out1 = block.conv1_2.apply(block.conv1_1.apply(features).relu_())
        out2 = block.conv2_1.apply(rows).relu_().view(1, *features.shape[2:], -1)
        out2 = block.conv2_2.apply(out2.permute(0, 4, 1, 2, 3))
        for first in range(0, len(rows), _CHUNK_ROWS):
            chunk = slice(first, first + _CHUNK_ROWS)
            _add_branches(rows[chunk], _rows(out1)[chunk], _rows(out2)[chunk], block.conv2_3)
    return features


def _add_branches(rows: Tensor, out1: Tensor, out2: Tensor, out: MatrixConv) -> None:
    half = out1.shape[1]
    rows[:, :half] += out1.relu_()
    rows[:, half:] += out.apply(out2.relu_()).relu_()
    rows.relu_()


def _rows(features: Tensor) -> Tensor:
    return features.permute(0, 2, 3, 4, 1).view(-1, features.shape[1])


class DeviceTransforms:
    """The transforms g_a, g_s and h_a on a device such as a GPU.

    The methods are those of `CpuTransforms`.
    """

    def __init__(self, model: PCGCv1) -> None:
        self._model, self._device = model, device_of(model)

    def analyse(self, occupied: Floats32, rate: int) -> tuple[Integers, Integers]:
        """Compute the quantised latents of a cube, as `CpuTransforms.analyse` does."""
        with torch.inference_mode():
            latents = self._model.latents(self._to_device(occupied)[None, None], rate)
            return quantised(latents.y.cpu()), quantised(latents.z.cpu())

    def synthesise(self, y_hat: Integers, rate: int, blocks: Bools) -> Floats32:
        """Compute the occupancy of a cube from its latent, as `CpuTransforms.synthesise` does."""
        with torch.inference_mode():
            y = self._to_device(y_hat)[None].float() / self._model.gain(rate)
            logits: Floats32 = self._model.g_s(y).flatten().cpu().numpy()
        return logits

    def _to_device(self, values: Floats32 | Integers) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values)).to(self._device)

"""The network 3D-MiniNet as a PyTorch module, with the names of parameters of published weights."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

SIDE = 4
"""Rows and columns of a window of the range image, whose points are described together."""
ABSOLUTE, CHANNELS = 5, 11
"""Channels of a pixel: the normalised range, x, y, z and remission; then the same relative to the
mean of the window, and the distance from this mean."""
_NEIGHBOURS = SIDE**2
_SLOPE = 0.1
_EPSILON = 1e-3
_DILATIONS = ((1, 1), (1, 4))
"""Dilations (rows, columns) of the blocks at the coarsest resolution, repeated."""


def _pointwise(before: int, after: int) -> nn.Conv2d:
    return nn.Conv2d(before, after, 1, bias=False)


def _depthwise(channels: int, stride: int = 1, dilation: tuple[int, int] = (1, 1)) -> nn.Conv2d:
    return nn.Conv2d(channels, channels, 3, stride, dilation, dilation, groups=channels, bias=False)


class _Separable(nn.Module):
    """A depthwise and a pointwise convolution, with a residual connection between equal widths.

    With a `dilation`, a second depthwise convolution with this dilation is added to the first.
    """

    def __init__(self, before: int, after: int, dilation: tuple[int, int] | None = None) -> None:
        super().__init__()
        self.conv1, self.bn1 = _depthwise(before), nn.BatchNorm2d(before, _EPSILON)
        if dilation is not None:
            self.conv2 = _depthwise(before, dilation=dilation)
            self.bn2 = nn.BatchNorm2d(before, _EPSILON)
        self.is_dilated = dilation is not None
        self.pointwise, self.bn = _pointwise(before, after), nn.BatchNorm2d(after, _EPSILON)

    def forward(self, x: Tensor) -> Tensor:
        """Return the output (b, after, rows, columns) for an input (b, before, rows, columns)."""
        inner = functional.leaky_relu(self.bn1(self.conv1(x)), _SLOPE)
        if self.is_dilated:
            inner = inner + functional.leaky_relu(self.bn2(self.conv2(x)), _SLOPE)
        outer = functional.leaky_relu(self.bn(self.pointwise(inner)), _SLOPE)
        return outer + x if outer.shape[1] == x.shape[1] else outer


class _Pair(nn.Module):
    """Two separable convolutions; the second has twice the dilation of the first."""

    def __init__(self, width: int, dilation: tuple[int, int] | None = None) -> None:
        super().__init__()
        twice = None if dilation is None else (2 * dilation[0], 2 * dilation[1])
        self.conv1, self.conv2 = _Separable(width, width, dilation), _Separable(width, width, twice)

    def forward(self, x: Tensor) -> Tensor:
        """Return the output, of the shape of the input."""
        result: Tensor = self.conv2(self.conv1(x))
        return result


class _Half(nn.Module):
    """A block of the decoder: one separable convolution."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.conv1 = _Separable(before, after)

    def forward(self, x: Tensor) -> Tensor:
        """Return the output (b, after, rows, columns) for an input (b, before, rows, columns)."""
        result: Tensor = self.conv1(x)
        return result


def _halving(before: int, after: int, names: tuple[str, str]) -> dict[str, nn.Module]:
    """Return the layers that halve the resolution, by name."""
    number, last = names
    return {
        f"conv{number}": _depthwise(before, stride=2),
        f"bn{number}": nn.BatchNorm2d(before),
        f"relu{number}": nn.LeakyReLU(_SLOPE),
        f"conv{last}": _pointwise(before, after),
        f"bn{last}": nn.BatchNorm2d(after),
        f"relu{last}": nn.LeakyReLU(_SLOPE),
    }


def _sequence(layers: Mapping[str, nn.Module]) -> nn.Sequential:
    sequence = nn.Sequential()
    for name, layer in layers.items():
        sequence.add_module(name, layer)
    return sequence


class _Windows(nn.Module):
    """Description of each window of the range image by its points and by the windows around it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        wide = (width // 8, width // 4, width // 2, width)
        for number, (before, after) in enumerate(
            zip((CHANNELS, *wide), wide, strict=False), start=1
        ):
            self.add_module(f"conv_fc{number}", _pointwise(before, after))
            self.add_module(f"bn{number}", nn.BatchNorm2d(after, _EPSILON))
        for number, after in enumerate((wide[2], wide[1], wide[1]), start=1):
            self.add_module(f"conv_fc_context_{number}", _pointwise(wide[1], after))
            self.add_module(f"bn_context_{number}", nn.BatchNorm2d(after, _EPSILON))
        self.conv = nn.Conv2d(CHANNELS, width, (_NEIGHBOURS, 1), bias=False)
        self.bn_conv = nn.BatchNorm2d(width, _EPSILON)
        self.conv_atten = nn.Conv2d(3 * width, 3 * width, 1)
        self.conv_out, self.bn_out = _pointwise(3 * width, width), nn.BatchNorm2d(width, _EPSILON)

    def _layer(self, x: Tensor, name: str, norm: str) -> Tensor:
        conv, normalised = self.get_submodule(name), self.get_submodule(norm)
        result: Tensor = functional.relu(normalised(conv(x)))
        return result

    def forward(self, windows: Tensor, rows: int) -> Tensor:
        """Return features (b, width, rows, columns) of windows (b, 11, 16, rows * columns)."""
        second = self._layer(self._layer(windows, "conv_fc1", "bn1"), "conv_fc2", "bn2")
        local = self._layer(self._layer(second, "conv_fc3", "bn3"), "conv_fc4", "bn4")
        spatial = self._layer(windows, "conv", "bn_conv")
        around = self._around(_image(second.amax(dim=2), rows))
        joined = torch.cat([_image(local.amax(dim=2), rows), _image(spatial[:, :, 0], rows)], 1)
        features = torch.cat([joined, around], dim=1)
        weights = torch.sigmoid(self.conv_atten(functional.adaptive_avg_pool2d(features, 1)))
        return self._layer(features * weights, "conv_out", "bn_out")

    def _around(self, image: Tensor) -> Tensor:
        """Return features of the 3 x 3 windows around each, at three distances."""
        count, channels, rows, columns = image.shape
        found = []
        for distance in (1, 2, 3):
            near = functional.unfold(image, 3, dilation=distance, padding=distance)
            near = near.view(count, channels, 9, rows * columns)
            names = f"conv_fc_context_{distance}", f"bn_context_{distance}"
            found.append(_image(self._layer(near, *names).amax(dim=2), rows))
        return torch.cat(found, dim=1)


def _image(values: Tensor, rows: int) -> Tensor:
    """Return values (b, channels, rows * columns) as an image (b, channels, rows, columns)."""
    return values.view(*values.shape[:2], rows, -1)


class MiniNetModule(nn.Module):
    """3D-MiniNet: features of windows of 4 x 4 pixels, an encoder, a decoder and a head.

    Parameters
    ----------
    width
        Number of features of a window.
    blocks
        Numbers of blocks of the encoder at a quarter and an eighth of the resolution.
    back
        Numbers of blocks of the decoder at a quarter and a half of the resolution.
    classes
        Number of classes.
    """

    def __init__(
        self, width: int, blocks: tuple[int, int], back: tuple[int, int], classes: int
    ) -> None:
        super().__init__()
        dilations = [_DILATIONS[number % len(_DILATIONS)] for number in range(blocks[1])]
        self.backbone = nn.ModuleDict(
            {
                "proj": _Windows(width),
                "enc1": _sequence(_halving(ABSOLUTE, width, ("0", "01"))),
                "enc2": _sequence({f"residual_{n}": _Pair(width) for n in range(blocks[0])}),
                "enc3": _sequence(
                    _halving(width, width, ("00", "01"))
                    | {f"residual_{n}": _Pair(width, each) for n, each in enumerate(dilations)}
                ),
            }
        )
        self.decoder = nn.ModuleDict(
            {
                "dec4": _sequence(_halves(width, width, back[0])),
                "dec3": _sequence(_halves(width, width // 2, back[1])),
            }
        )
        self.head = nn.Sequential(nn.Conv2d(width // 2, classes, 3, padding=1))

    def forward(self, image: Tensor, windows: Tensor) -> Tensor:
        """Return the logits of all classes.

        Parameters
        ----------
        image
            Normalised channels of pixels, (b, 5, rows, columns), a multiple of 8 rows and columns.
        windows
            All channels of the pixels of each window, (b, 11, 16, rows * columns / 16).

        Returns
        -------
        Tensor
            Logits (b, classes, rows, columns).
        """
        backbone, decoder = self.backbone, self.decoder
        half = backbone["enc1"](image)
        quarter = backbone["enc2"](backbone["proj"](windows, image.shape[2] // SIDE))
        x = backbone["enc3"](quarter)
        x = decoder["dec4"](_doubled(x) + quarter)
        x = decoder["dec3"](_doubled(x) + half)
        result: Tensor = self.head(_doubled(x))
        return result


def _halves(before: int, after: int, blocks: int) -> dict[str, nn.Module]:
    more = {f"residual{number}": _Half(after, after) for number in range(blocks - 1)}
    return {"residual": _Half(before, after), **more}


def _doubled(x: Tensor) -> Tensor:
    size = (2 * x.shape[2], 2 * x.shape[3])
    return functional.interpolate(x, size=size, mode="bilinear", align_corners=True)

"""Files of LiZIP's trained weights, and their arrangement for inference.

A file has the magic "LIZM", the number of layers (uint32), and for each layer its numbers of inputs
and outputs (uint32 each), its matrix (outputs, inputs) and its biases, all float32, little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointkit.coding.byte_io import Reader
from pointkit.errors import InputError, naming

Floats32 = NDArray[np.float32]
MAGIC = b"LIZM"
LANES = 8
"""Partial sums of an output, between which the inputs take turns (see `inference`)."""
WIDE = 32
"""Outputs that are computed together."""
HEAD = 5
"""Points at the start of a block that are stored, not predicted: the network reads the first of
the last five points."""
_FAULT = "not weights of LiZIP"
_MOST_LAYERS, _MOST_OUTPUTS = 16, 4096
_SIZES = struct.Struct("<II")


@dataclass(frozen=True)
class Layer:
    """A linear layer, with its matrix in the order in which `inference` reads it.

    The matrix is divided into chunks of 32 outputs; unused outputs of the last are 0. The inputs
    up to the last multiple of 8 are divided into 8 lanes.
    """

    inputs: int
    outputs: int
    lanes: Floats32  # flat array of (chunks, 8 lanes, inputs // 8, 32)
    rest: Floats32  # flat array of (chunks, inputs % 8, 32), of the last inputs
    bias: Floats32  # (outputs,)


@dataclass(frozen=True)
class LizipWeights:
    """Trained weights of LiZIP."""

    digest: bytes  # 8 bytes by which streams name the network
    layers: tuple[Layer, ...]  # a ReLU follows each but the last

    @property
    def context(self) -> int:
        """Number of points that the network reads."""
        return self.layers[0].inputs // 3


def load_weights(path: str | Path) -> LizipWeights:
    """Read a file of weights (``.bin``) of LiZIP's authors.

    Parameters
    ----------
    path
        Path of the file, such as ``mlp_c3_h256.bin``.

    Returns
    -------
    LizipWeights
        The network, for `encode` and `decode`.

    Raises
    ------
    InputError
        If the file is damaged, is not a file of LiZIP, or has a network that reads more than five
        points, for which the authors' program in C++ has no room.
    """
    from pcc_networks.weights_file import digest_of
    from pointkit.files import read_bytes

    data = read_bytes(Path(path))
    with naming(str(path)):
        matrices = list(_layers(data))
        _check_shapes([matrix.shape for matrix, _ in matrices])
        return LizipWeights(digest_of(data), tuple(_arranged(*layer) for layer in matrices))


def _layers(data: bytes) -> Iterator[tuple[Floats32, Floats32]]:
    if not data.startswith(MAGIC):
        raise InputError(_FAULT)
    with naming(_FAULT):
        reader = Reader(data[len(MAGIC) :])
        (count,) = struct.unpack("<I", reader.take(4))
        for _ in range(min(count, _MOST_LAYERS + 1)):
            inputs, outputs = _SIZES.unpack(reader.take(_SIZES.size))
            matrix = _floats(reader, outputs * inputs).reshape(outputs, inputs)
            yield matrix, _floats(reader, outputs)
        if reader.at != len(reader.body):
            raise InputError("its length")


def _floats(reader: Reader, count: int) -> Floats32:
    numbers = np.frombuffer(reader.take(4 * count), "<f4").astype(np.float32)
    if not np.isfinite(numbers).all():
        raise InputError("a number is not finite")
    return numbers


def _check_shapes(shapes: list[tuple[int, ...]]) -> None:
    fits = 0 < len(shapes) <= _MOST_LAYERS and shapes[-1][0] == 3
    fits = fits and all(before[0] == after[1] for before, after in pairwise(shapes))
    if not fits or max(max(shape) for shape in shapes) > _MOST_OUTPUTS:
        raise InputError(f"{_FAULT} (sizes of its layers)")
    inputs = shapes[0][1]
    if inputs % 3 or not 0 < inputs <= 3 * HEAD:
        raise InputError(f"the network has {inputs} inputs; up to {HEAD} points can be read")


def _arranged(matrix: Floats32, bias: Floats32) -> Layer:
    outputs, inputs = matrix.shape
    chunks, each = -(-outputs // WIDE), inputs // LANES
    padded = np.zeros((chunks * WIDE, inputs), np.float32)
    padded[:outputs] = matrix
    padded = padded.reshape(chunks, WIDE, inputs)
    lanes = padded[:, :, : each * LANES].reshape(chunks, WIDE, each, LANES)
    rest = padded[:, :, each * LANES :]
    return Layer(
        inputs,
        outputs,
        np.ascontiguousarray(lanes.transpose(0, 3, 2, 1)).ravel(),
        np.ascontiguousarray(rest.transpose(0, 2, 1)).ravel(),
        bias,
    )

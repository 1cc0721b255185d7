from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pcc_networks.sparse.voxels import CHILDREN, OFFSETS

Floats32 = NDArray[np.float32]
OCCUPANCIES, VALUES = 2**CHILDREN, 16
"""Numbers of occupancies, and of values of each of the two symbols of an occupancy."""
MAX_CHANNELS = 256
_FAULT = "not a checkpoint of RENO"
_NETWORKS = ("prior_resnet", "target_resnet")
_LAYERS = ("0", "2.conv0", "2.conv1", "3.conv0", "3.conv1")
_HEADS = ("pred_head_s0", "pred_head_s1")


Head = tuple[Floats32, Floats32, Floats32, Floats32]
"""Weights and biases of two linear layers that map features to the logits of a symbol; matrices are
flattened from (inputs, outputs)."""


@dataclass(frozen=True)
class RenoWeights:
    """Trained weights of RENO, as flat arrays of 32-bit floats."""

    digest: bytes  # 8 bytes by which streams name the network
    channels: int  # of the features, c
    occupancy_embedding: Floats32  # (256, c), of a voxel's occupancy
    child_embedding: Floats32  # (8, c), of the number within the parent
    symbol_embedding: Floats32  # (16, c), of the first symbol
    prior: tuple[Floats32, ...]  # kernels (27, c, c) of the five convolutions on a level
    target: tuple[Floats32, ...]  # the same on the next finer level
    heads: tuple[Head, Head]  # of first and of second symbols


def load_weights(path: str | Path) -> RenoWeights:
    """Read a checkpoint (``.pt``) of RENO's authors, without running code from the file.

    Parameters
    ----------
    path
        Path of the file, such as ``KITTIDetection.pt``.

    Returns
    -------
    RenoWeights
        The parameters of the network, for `encode` and `decode`.

    Raises
    ------
    InputError
        If the file is damaged, or is not a checkpoint of RENO.
    """
    from pcc_networks.weights_file import checkpoint_arrays, digest_of, read_checkpoint, telling
    from pointkit.files import read_bytes

    path = Path(path)
    checkpoint = read_checkpoint(path, _FAULT)
    with telling(f"{path}: {_FAULT}"):
        channels = checkpoint["prior_embedding.weight"].shape[1]
        if not 1 <= channels <= MAX_CHANNELS:
            raise ValueError(f"{channels} channels")
        arrays = checkpoint_arrays(checkpoint, shapes(channels), np.float32)
    return _weights(digest_of(read_bytes(path)), arrays)


def shapes(channels: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each parameter of a checkpoint, by name."""
    result: dict[str, tuple[int, ...]] = {
        "prior_embedding.weight": (OCCUPANCIES, channels),
        "target_embedding.target_res_embedding.weight": (CHILDREN, channels),
        "pred_head_s1_emb.weight": (VALUES, channels),
    }
    for network in _NETWORKS:
        for layer in _LAYERS:
            result[f"{network}.{layer}.kernel"] = (OFFSETS, channels, channels)
    for head in _HEADS:
        result |= {f"{head}.0.weight": (channels, channels), f"{head}.0.bias": (channels,)}
        result |= {f"{head}.2.weight": (VALUES, channels), f"{head}.2.bias": (VALUES,)}
    return result


def _weights(digest: bytes, arrays: Mapping[str, Floats32]) -> RenoWeights:
    prior, target = (
        tuple(arrays[f"{network}.{layer}.kernel"].ravel() for layer in _LAYERS)
        for network in _NETWORKS
    )
    return RenoWeights(
        digest,
        arrays["prior_embedding.weight"].shape[1],
        arrays["prior_embedding.weight"].ravel(),
        arrays["target_embedding.target_res_embedding.weight"].ravel(),
        arrays["pred_head_s1_emb.weight"].ravel(),
        prior,
        target,
        (_head(_HEADS[0], arrays), _head(_HEADS[1], arrays)),
    )


def _head(name: str, arrays: Mapping[str, Floats32]) -> Head:
    # transposed, since PyTorch stores matrices as (out, in)
    hidden, logits = (np.ascontiguousarray(arrays[f"{name}.{i}.weight"].T).ravel() for i in (0, 2))
    return hidden, arrays[f"{name}.0.bias"], logits, arrays[f"{name}.2.bias"]

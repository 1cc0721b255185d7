from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pcc_networks.polopcac.fixed_point import Floats, Linear, fixed_linear

CHANNELS = 3
"""Values of a point that the network reads and predicts."""
OUTPUTS = 2 * CHANNELS
MAX_CHANNELS, MAX_LAYERS = 256, 16
_AXES = 3
_HIDDEN = (64, 16)
"""Widths of the hidden layers that turn a point's features into the outputs."""
_FAULT = "not a checkpoint of PoLoPCAC"
_LAYER = re.compile(r"pt\.sa_emb_ls\.(\d+)\.0\.weight")


class AttentionLayer(NamedTuple):
    """A layer of the network, which weighs the features of a point's neighbours."""

    embedding: Linear
    key_value: Linear  # keys, then values
    factor: tuple[Linear, Linear]  # of keys, from the neighbours' offsets
    summand: tuple[Linear, Linear]  # of keys and values, from the neighbours' offsets
    scores: tuple[Linear, Linear]
    output: Linear


@dataclass(frozen=True)
class PolopcacWeights:
    """Trained weights of PoLoPCAC, in fixed point."""

    digest: bytes  # 8 bytes by which streams name the network
    channels: int  # of the features
    first: Linear
    layers: tuple[AttentionLayer, ...]
    head: tuple[Linear, ...]


def load_weights(path: str | Path) -> PolopcacWeights:
    """Read a checkpoint (``ckpt.pt``) of PoLoPCAC's authors, without running code from the file.

    Parameters
    ----------
    path
        Path of the file.

    Returns
    -------
    PolopcacWeights
        The parameters of the network, for `encode` and `decode`.

    Raises
    ------
    InputError
        If the file is damaged, or is not a checkpoint of PoLoPCAC.
    """
    from pcc_networks.weights_file import digest_of, read_checkpoint, telling
    from pointkit.files import read_bytes

    path = Path(path)
    checkpoint = read_checkpoint(path, _FAULT)
    with telling(f"{path}: {_FAULT}"):
        return _weights(digest_of(read_bytes(path)), checkpoint)


def shapes(channels: int, layers: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each parameter of a checkpoint, by name."""
    inner = (channels, channels)
    sizes = {"pt.linear_in": (channels, CHANNELS)}
    for number in range(layers):
        attention = f"pt.sa_ls.{number}"
        sizes[f"pt.sa_emb_ls.{number}.0"] = inner
        for name in ("k_mlp", "v_mlp", "residual_emb.1", "weight_encoding.0", "weight_encoding.2"):
            sizes[f"{attention}.{name}"] = inner
        for name in ("linear_p_multiplier", "linear_p_bias"):
            sizes[f"{attention}.{name}.0"] = (channels, _AXES)
            sizes[f"{attention}.{name}.2"] = inner
    widths = (channels, *_HIDDEN, OUTPUTS)
    for place, (inputs, outputs) in enumerate(pairwise(widths)):
        sizes[f"mu_sigma_pred.{2 * place}"] = (outputs, inputs)
    result: dict[str, tuple[int, ...]] = {}
    for name, size in sizes.items():
        is_convolution = name.startswith("pt.")
        result[f"{name}.weight"] = (*size, 1, 1) if is_convolution else size
        result[f"{name}.bias"] = size[:1]
    return result


def _weights(digest: bytes, checkpoint: Mapping[str, Any]) -> PolopcacWeights:
    from pcc_networks.weights_file import checkpoint_arrays

    channels = checkpoint["pt.linear_in.weight"].shape[0]
    layers = sum(bool(_LAYER.fullmatch(str(name))) for name in checkpoint)
    if not 1 <= channels <= MAX_CHANNELS or not 1 <= layers <= MAX_LAYERS:
        raise ValueError(f"{channels} channels, {layers} layers")
    found = checkpoint_arrays(checkpoint, shapes(channels, layers), np.float64)
    arrays = {name: array.reshape(array.shape[:2]) for name, array in found.items()}
    return PolopcacWeights(
        digest,
        channels,
        _linear(arrays, "pt.linear_in"),
        tuple(_layer(arrays, number) for number in range(layers)),
        tuple(_linear(arrays, f"mu_sigma_pred.{place}") for place in (0, 2, 4)),
    )


def _layer(arrays: Mapping[str, Floats], number: int) -> AttentionLayer:
    attention = f"pt.sa_ls.{number}"

    def pair(name: str) -> tuple[Linear, Linear]:
        return (
            _linear(arrays, f"{attention}.{name}.0"),
            _linear(arrays, f"{attention}.{name}.2"),
        )

    return AttentionLayer(
        _linear(arrays, f"pt.sa_emb_ls.{number}.0"),
        _linear(arrays, f"{attention}.k_mlp", f"{attention}.v_mlp"),
        pair("linear_p_multiplier"),
        pair("linear_p_bias"),
        pair("weight_encoding"),
        _linear(arrays, f"{attention}.residual_emb.1"),
    )


def _linear(arrays: Mapping[str, Floats], *names: str) -> Linear:
    weight, bias = (
        np.concatenate([arrays[f"{name}.{part}"] for name in names]) for part in ("weight", "bias")
    )
    return fixed_linear(weight, bias)

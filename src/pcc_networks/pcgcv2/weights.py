from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pcc_networks.catalogue import PCGCV2, weights_path
from pcc_networks.pcgcv2.model import SCALES, PCGCv2, Pcgcv2Shape
from pcc_networks.weights_file import (
    DeviceName,
    MultiRateWeights,
    load_multi_rate,
    placed,
    read_checkpoint,
)
from pointkit.errors import InputError

Pcgcv2Weights = MultiRateWeights[PCGCv2]
_BLOCK_LAYERS = ("conv0_0", "conv0_1", "conv1_0", "conv1_1", "conv1_2")
_PARTS = {"encoder": "g_a", "decoder": "g_s"}
_BOTTLENECK = {"matrices": "_matrices", "biases": "_biases", "factors": "_factors"}


def load_weights(where: str | Path, device: DeviceName = "cpu") -> Pcgcv2Weights:
    """Read trained weights of PCGCv2.

    Parameters
    ----------
    where
        Name of weights that come with the package (``pcgcv2_objects`` or ``pcgcv2_rooms``), or the
        path of a file. The file was either written by `Pcgcv2Training.export`, or is a checkpoint
        (``.pth``) of the network's authors.
    device
        Device on which the network runs, ``cpu`` or ``cuda``.

    Returns
    -------
    Pcgcv2Weights
        The network with its parameters, for `encode` and `decode`.

    Raises
    ------
    InputError
        If the file is damaged or of another network, or if the device does not exist.
    """
    path = weights_path(where)
    weights = load_multi_rate(path, PCGCV2, PCGCv2, load_published)
    placed(weights.model, device)
    return weights


def load_published(path: Path) -> PCGCv2:
    """Read a checkpoint of the authors, and return the network.

    Denormal weights are set to zero, because they slow some processors down a hundredfold. Results
    do not change.

    Raises
    ------
    InputError
        If the file is not such a checkpoint.
    """
    checkpoint = _read(path)
    model = PCGCv2(Pcgcv2Shape())
    try:
        model.load_state_dict(_translated(checkpoint))
    except (KeyError, RuntimeError) as error:
        reason = str(error).splitlines()[-1].strip()
        raise InputError(f"{path}: not a checkpoint of PCGCv2 ({reason})") from error
    return model.eval()


def _read(path: Path) -> dict[str, Any]:
    checkpoint = read_checkpoint(path, "not a checkpoint of PCGCv2")
    if not {*_PARTS, "entropy_bottleneck"} <= set(checkpoint):
        raise InputError(f"{path}: not a checkpoint of PCGCv2")
    return checkpoint


def _translated(checkpoint: dict[str, dict[str, Tensor]]) -> dict[str, Tensor]:
    state = {}
    for part in _PARTS:
        for name, value in checkpoint[part].items():
            kernel = value.ndim == 2 and name.endswith("kernel")
            flat = value[0] if name.endswith("bias") else value[None] if kernel else value
            module, _, parameter = name.rpartition(".")
            our_name = f"{_NAMES[part, module]}.{parameter}"
            state[our_name] = flat.masked_fill(flat.abs() < torch.finfo(flat.dtype).tiny, 0)
    for (our_name, their_name), layer in product(_BOTTLENECK.items(), range(4)):
        value = checkpoint["entropy_bottleneck"][f"{their_name}.{layer}"]
        state[f"entropy_bottlenecks.0.{our_name}.{layer}"] = value
    state["log_gains"] = torch.zeros(1, Pcgcv2Shape().latent_channels)
    return state


def _names() -> dict[tuple[str, str], str]:
    names = {("encoder", "conv0"): "g_a.conv0"}
    for scale in range(SCALES):
        g_a, g_s = f"g_a.scales.{scale}", f"g_s.scales.{scale}"
        names["encoder", f"down{scale}"] = f"{g_a}.down"
        names["encoder", f"conv{scale + 1}"] = f"{g_a}.conv"
        names["decoder", f"up{scale}"] = f"{g_s}.up"
        names["decoder", f"conv{scale}"] = f"{g_s}.conv"
        names["decoder", f"conv{scale}_cls"] = f"{g_s}.conv_cls"
        for part, block, layer in product(_PARTS, range(Pcgcv2Shape().blocks), _BLOCK_LAYERS):
            our_name = f"{_PARTS[part]}.scales.{scale}.blocks.{block}.{layer}"
            names[part, f"block{scale}.{block}.{layer}"] = our_name
    return names


_NAMES = _names()

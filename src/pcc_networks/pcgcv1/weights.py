"""Reading of trained weights of PCGCv1, from puckbench's files and from the authors' archives.

In the authors' NumPy archives, kernels have axes (d, h, w, in, out), or (d, h, w, out, in) in
transposed convolutions.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pcc_networks.catalogue import PCGCV1, weights_path
from pcc_networks.pcgcv1.hyper_prior import IntegerHyperSynthesis
from pcc_networks.pcgcv1.inference import CpuTransforms, DeviceTransforms
from pcc_networks.pcgcv1.model import PCGCv1, Pcgcv1Shape
from pcc_networks.weights_file import DeviceName, MultiRateWeights, load_multi_rate, placed
from pointkit.errors import InputError, naming
from pointkit.files import read_bytes

_BLOCK_LAYERS = ("conv1_1", "conv1_2", "conv2_1", "conv2_2", "conv2_3")
_LAYERS = {
    "analysis_transform/conv_in": "g_a.conv_in",
    "analysis_transform/down_1": "g_a.downs.0",
    "analysis_transform/down_2": "g_a.downs.1",
    "analysis_transform/conv_out": "g_a.conv_out",
    "synthesis_transform/deconv_in": "g_s.conv_in",
    "synthesis_transform/up_1": "g_s.ups.0",
    "synthesis_transform/up_2": "g_s.ups.1",
    "synthesis_transform/deconv_out": "g_s.conv_out",
    **{f"hyper_encoder/conv{layer}": f"h_a.conv{layer}" for layer in (1, 2, 3)},
    **{f"hyper_decoder/conv{layer}": f"h_s.conv{layer}" for layer in (1, 2, 3)},
    "hyper_decoder/conv4_1": "h_s.location",
    "hyper_decoder/conv4_2": "h_s.scale",
}
_BOTTLENECK = {"matrix": "matrices", "bais": "biases", "factor": "factors"}
"""The authors misspell "bias"."""
_KERNEL_AXES = (4, 3, 0, 1, 2)
"""Permutation of the axes of both layouts to PyTorch's order."""


@dataclass(frozen=True)
class Pcgcv1Weights(MultiRateWeights[PCGCv1]):
    """Trained weights of PCGCv1 for one or several rates, ready for `encode` and `decode`."""

    network: CpuTransforms | DeviceTransforms  # transforms g_a, g_s and h_a
    hyper_synthesis: IntegerHyperSynthesis  # transform h_s in integers


def load_weights(where: str | Path, device: DeviceName = "cpu") -> Pcgcv1Weights:
    """Read trained weights of PCGCv1.

    Parameters
    ----------
    where
        Name of weights that come with the package (``pcgcv1_mixed``), or the path of a file. The
        file was either written by `Pcgcv1Training.export`, or is an archive (``.npz``) of the
        network's authors.
    device
        Device on which the network runs, ``cpu`` or ``cuda``. The hyper-synthesis transform stays
        on the CPU, where its sums are exact.

    Returns
    -------
    Pcgcv1Weights
        The network with its parameters, for `encode` and `decode`.

    Raises
    ------
    InputError
        If the file is damaged or of another network, or if the device does not exist.
    """
    path = weights_path(where)
    weights = load_multi_rate(path, PCGCV1, PCGCv1, load_published)
    model = weights.model
    with naming(path):
        hyper_synthesis = IntegerHyperSynthesis(model.h_s)
    network = CpuTransforms(model) if device == "cpu" else DeviceTransforms(placed(model, device))
    return Pcgcv1Weights(**vars(weights), network=network, hyper_synthesis=hyper_synthesis)


def load_published(path: Path) -> PCGCv1:
    """Read an archive of the authors, and return the network.

    Raises InputError if the file is not such an archive.
    """
    variables = _read(path)
    model = PCGCv1(Pcgcv1Shape())
    try:
        model.load_state_dict(_translated(variables))
    except (KeyError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: not the variables of PCGCv1") from error
    return model.eval()


def _read(path: Path) -> dict[str, NDArray[np.float32]]:
    data = read_bytes(path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: np.asarray(archive[name], dtype=np.float32) for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a NumPy archive of weights") from error


def _translated(variables: Mapping[str, NDArray[Any]]) -> dict[str, Tensor]:
    names = dict(_names())
    state = {"log_gains": torch.zeros(1, Pcgcv1Shape().latent_channels)}
    for name, value in variables.items():
        layer, _, kind = name.rpartition("/")
        kernel = kind == "kernel"
        our_name = (
            f"{names[layer]}.{'weight' if kernel else kind}" if layer in names else names[name]
        )
        ordered = value.transpose(_KERNEL_AXES) if kernel else value
        state[our_name] = torch.from_numpy(np.ascontiguousarray(ordered, dtype=np.float32))
    return state


def _names() -> Iterator[tuple[str, str]]:
    yield from _LAYERS.items()
    parts = {"analysis": "g_a", "synthesis": "g_s"}
    blocks = range(Pcgcv1Shape().blocks)
    for part, scale, block, layer in product(parts, range(3), blocks, _BLOCK_LAYERS):
        their_name = f"{part}_transform/vrn{scale + 1}_{block + 1}/{layer}"
        yield their_name, f"{parts[part]}.blocks.{scale}.{block}.{layer}"
    for (their_name, our_name), number in product(_BOTTLENECK.items(), range(4)):
        yield f"estimator/{their_name}_{number}", f"entropy_bottlenecks.0.{our_name}.{number}"

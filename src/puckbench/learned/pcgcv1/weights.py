"""PCGCv1's weights: sets of ours, and the authors' archives under our names of parameters.

The authors' TensorFlow variables are read from NumPy archives. A kernel is stored as [d, h, w, in,
out], that of a transposed convolution as [d, h, w, out, in].
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

from puckbench.core.errors import InputError, naming
from puckbench.core.files import read_bytes
from puckbench.core.models import parsed
from puckbench.learned.catalogue import PCGCV1, weights_path
from puckbench.learned.device import DeviceName, placed
from puckbench.learned.pcgcv1.device_inference import DeviceTransforms
from puckbench.learned.pcgcv1.inference import CpuTransforms, Transforms
from puckbench.learned.pcgcv1.integer_hyper_decoder import IntegerHyperSynthesis
from puckbench.learned.pcgcv1.model import PCGCv1, Pcgcv1Shape
from puckbench.learned.weights_file import Tables, load_multi_rate, save_multi_rate

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
"""The authors' spelling of a bias is theirs."""
_KERNEL_AXES = (4, 3, 0, 1, 2)
"""Both layouts have what PyTorch wants first at the end: (out, in) or, transposed, (in, out)."""


@dataclass(frozen=True)
class Pcgcv1Weights:
    """A network ready for coding; see `MultiRateWeights` for the other fields.

    Parameters
    ----------
    network
        Transforms g_a, g_s and h_a.
    hyper_synthesis
        Transform h_s in integers.
    tables
        Frequency tables of the hyper-latent.
    """

    shape: Pcgcv1Shape
    network: Transforms
    hyper_synthesis: IntegerHyperSynthesis
    lmbdas: tuple[float, ...]
    tables: Tables
    digest: bytes
    card: Mapping[str, Any]


def load_weights(where: str | Path, device: DeviceName = "cpu") -> Pcgcv1Weights:
    """Read trained weights.

    Parameters
    ----------
    where
        Name of a shipped set, or path of a set or of one of the authors' archives.
    device
        Device of the network. The transform h_s stays on the CPU, where its sums are exact.

    Raises
    ------
    InputError
        If the file is neither, or the device does not exist.
    """
    path = weights_path(where)
    found = load_multi_rate(
        path,
        PCGCV1,
        lambda sizes: PCGCv1(parsed(Pcgcv1Shape, sizes, f"{path}: shape")),
        load_published,
    )
    with naming(path):
        hyper_synthesis = IntegerHyperSynthesis(found.model.h_s)
    rest = (found.lmbdas, found.tables, found.digest, found.card)
    model = found.model
    network = CpuTransforms(model) if device == "cpu" else DeviceTransforms(placed(model, device))
    return Pcgcv1Weights(model.shape, network, hyper_synthesis, *rest)


def save_weights(
    path: Path, model: PCGCv1, lmbdas: tuple[float, ...], card: Mapping[str, Any]
) -> Pcgcv1Weights:
    """Write a network as a set of weights and return the set, as `load_weights` reads it."""
    save_multi_rate(path, PCGCV1, model, lmbdas, card)
    return load_weights(path)


def load_published(path: Path) -> PCGCv1:
    """Read an archive of the authors' variables; InputError when it is not one."""
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
    """Parameters from the authors' variables; KeyError for a name that is not theirs."""
    names = dict(_names())
    state = {"log_gains": torch.zeros(1, Pcgcv1Shape().latent_channels)}
    for name, value in variables.items():
        layer, _, kind = name.rpartition("/")
        kernel = kind == "kernel"
        ours = f"{names[layer]}.{'weight' if kernel else kind}" if layer in names else names[name]
        ordered = value.transpose(_KERNEL_AXES) if kernel else value
        state[ours] = torch.from_numpy(np.ascontiguousarray(ordered, dtype=np.float32))
    return state


def _names() -> Iterator[tuple[str, str]]:
    """The authors' names of layers, and of the variables of the entropy bottleneck, and ours."""
    yield from _LAYERS.items()
    parts = {"analysis": "g_a", "synthesis": "g_s"}
    blocks = range(Pcgcv1Shape().blocks)
    for part, scale, block, layer in product(parts, range(3), blocks, _BLOCK_LAYERS):
        theirs = f"{part}_transform/vrn{scale + 1}_{block + 1}/{layer}"
        yield theirs, f"{parts[part]}.blocks.{scale}.{block}.{layer}"
    for (theirs, ours), number in product(_BOTTLENECK.items(), range(4)):
        yield f"estimator/{theirs}_{number}", f"entropy_bottlenecks.0.{ours}.{number}"

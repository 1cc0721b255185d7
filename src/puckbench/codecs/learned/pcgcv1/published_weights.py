"""The authors' weights: variables of TensorFlow checkpoints as NumPy archives.

A kernel is stored [d, h, w, in, out], a transposed one [d, h, w, out, in].
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from puckbench.codecs.learned.pcgcv1.model import PCGCv1, Shape
from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes

_BLOCK = {
    "conv1_1": "near_in",
    "conv1_2": "near_out",
    "conv2_1": "point_in",
    "conv2_2": "middle",
    "conv2_3": "point_out",
}
_LAYERS = {
    "analysis_transform/conv_in": "analysis.first",
    "analysis_transform/down_1": "analysis.downs.0",
    "analysis_transform/down_2": "analysis.downs.1",
    "analysis_transform/conv_out": "analysis.last",
    "synthesis_transform/deconv_in": "synthesis.first",
    "synthesis_transform/up_1": "synthesis.ups.0",
    "synthesis_transform/up_2": "synthesis.ups.1",
    "synthesis_transform/deconv_out": "synthesis.last",
    "hyper_encoder/conv1": "hyper_encoder.first",
    "hyper_encoder/conv2": "hyper_encoder.down",
    "hyper_encoder/conv3": "hyper_encoder.last",
    "hyper_decoder/conv1": "hyper_decoder.first",
    "hyper_decoder/conv2": "hyper_decoder.up",
    "hyper_decoder/conv3": "hyper_decoder.wide",
    "hyper_decoder/conv4_1": "hyper_decoder.location",
    "hyper_decoder/conv4_2": "hyper_decoder.scale",
}
_ESTIMATOR = {"matrix": "matrices", "bais": "biases", "factor": "factors"}
"""The authors' spelling of a bias is theirs."""
_ANY_KERNEL = (4, 3, 0, 1, 2)
"""Both layouts have what PyTorch wants first at the end: (out, in) or, transposed, (in, out)."""


def load_original(path: Path) -> PCGCv1:
    """The network of an archive; InputError when it is not one of the original's."""
    variables = _read(path)
    model = PCGCv1(Shape())
    try:
        model.load_state_dict(translated(variables))
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


def translated(variables: Mapping[str, NDArray[Any]]) -> dict[str, Tensor]:
    """Our names and layouts of the authors' variables; KeyError for a name that is not theirs."""
    names = dict(_names())
    state = {"log_gains": torch.zeros(1, Shape().latent)}
    for name, value in variables.items():
        layer, _, kind = name.rpartition("/")
        kernel = kind == "kernel"
        ours = f"{names[layer]}.{'weight' if kernel else kind}" if layer in names else names[name]
        laid = value.transpose(_ANY_KERNEL) if kernel else value
        state[ours] = torch.from_numpy(np.ascontiguousarray(laid, dtype=np.float32))
    return state


def _names() -> Iterator[tuple[str, str]]:
    yield from _LAYERS.items()
    for part in ("analysis", "synthesis"):
        for scale in range(3):
            for block in range(Shape().blocks):
                theirs = f"{part}_transform/vrn{scale + 1}_{block + 1}"
                ours = f"{part}.blocks.{scale}.{block}"
                yield from ((f"{theirs}/{a}", f"{ours}.{b}") for a, b in _BLOCK.items())
    for theirs, ours in _ESTIMATOR.items():
        for layer in range(4):
            yield f"estimator/{theirs}_{layer}", f"bottlenecks.0.{ours}.{layer}"

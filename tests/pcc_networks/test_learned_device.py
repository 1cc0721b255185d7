"""Learned codecs on a CUDA device: its code is run here on the CPU, and on CUDA where there is one.

What runs on a device is the models' own layers by PyTorch's functions, whatever the device is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from pcc_networks import pcgcv1, pcgcv2
from pcc_networks.pcgcv1 import weights as pcgcv1_weights
from pcc_networks.pcgcv1.inference import DeviceTransforms
from pcc_networks.pcgcv2 import inference as pcgcv2_inference
from pointkit.errors import InputError
from tests.support.learned_codecs import save_tiny, shell

POINTS = 40 + shell()
LIBRARIES = {"pcgcv1": pcgcv1, "pcgcv2": pcgcv2}
AS_PUBLISHED: dict[str, dict[str, Any]] = {
    "pcgcv1": {"context_mixing": False, "sparse_cubes": False, "point_reconstruction": False},
    "pcgcv2": {"tools": pcgcv2.CodingTools(0), "point_reconstruction": False},
}
CODERS = [(name, options) for name in LIBRARIES for options in (AS_PUBLISHED[name], {})]
"""Each network as its authors published it, and with all our tools."""
SHIPPED = {"pcgcv1_mixed": pcgcv1, "pcgcv2_objects": pcgcv2, "pcgcv2_rooms": pcgcv2}
cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
each_coder = pytest.mark.parametrize(("name", "options"), CODERS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights")
    for name in LIBRARIES:
        save_tiny(name, path / f"{name}.safetensors")
    return path


@pytest.fixture
def own_layers(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Take the code of a device for weights that are loaded from then on, on the CPU."""

    def take() -> None:
        monkeypatch.setattr(pcgcv2_inference, "is_fused", lambda _: False)
        monkeypatch.setattr(pcgcv1_weights, "CpuTransforms", DeviceTransforms)

    return take


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether as many points lie where the other has one; few voxels are chosen by rounding."""
    near, _ = cKDTree(other).query(one)
    return len(one) == len(other) and bool(np.quantile(near, 0.98) < 0.01)


def _check_alike(stream: bytes, again: bytes, expected: np.ndarray, decoded: np.ndarray) -> None:
    """That two ways of computing give the same stream and points, but for roundings."""
    result = np.unique(decoded, axis=0)
    # sums are rounded in another order
    assert abs(len(again) - len(stream)) <= max(2, 0.01 * len(stream))
    assert _alike(result, expected)


@each_coder
def test_the_models_own_layers_code_as_the_fused_ones_do(
    name: str, options: dict[str, Any], folder: Path, own_layers: Callable[[], None]
) -> None:
    library, path = LIBRARIES[name], folder / f"{name}.safetensors"
    weights = library.load_weights(path)
    rates = range(len(weights.lmbdas))
    streams = [library.encode(POINTS, weights, rate, **options) for rate in rates]
    decoded = [np.unique(library.decode(stream, weights), axis=0) for stream in streams]
    own_layers()
    other = library.load_weights(path)
    for stream, expected, rate in zip(streams, decoded, rates, strict=True):
        again = library.encode(POINTS, other, rate, **options)
        _check_alike(stream, again, expected, library.decode(stream, other))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_weights_code_by_the_models_own_layers(
    name: str, own_layers: Callable[[], None]
) -> None:
    """On a coarse and on a fine grid; the streams of either decode to the same surface."""
    library = SHIPPED[name]
    weights = library.load_weights(name)
    last = len(weights.lmbdas) - 1
    chosen = [
        {"rate": rate, "mean_occupied_children": 2.5, "grid_level_offset": offset}
        for rate, offset in ((0, 1.5), (last, -0.5))
    ]
    streams = [library.encode(POINTS, weights, **arguments) for arguments in chosen]
    decoded = [np.unique(library.decode(stream, weights), axis=0) for stream in streams]
    own_layers()
    other = library.load_weights(name)
    for stream, expected, arguments in zip(streams, decoded, chosen, strict=True):
        again = library.encode(POINTS, other, **arguments)
        _check_alike(stream, again, expected, library.decode(stream, other))


@pytest.mark.skipif(torch.cuda.is_available(), reason="for machines without CUDA")
@pytest.mark.parametrize("name", LIBRARIES)
def test_where_there_is_no_cuda_loading_says_so(name: str, folder: Path) -> None:
    with pytest.raises(InputError, match="device cuda: PyTorch finds no CUDA device here"):
        LIBRARIES[name].load_weights(folder / f"{name}.safetensors", "cuda")


@cuda
@each_coder
def test_streams_decode_on_either_side(name: str, options: dict[str, Any], folder: Path) -> None:
    library, path = LIBRARIES[name], folder / f"{name}.safetensors"
    here, there = library.load_weights(path), library.load_weights(path, "cuda")
    for rate in range(len(here.lmbdas)):
        for weights in (here, there):
            made = library.encode(POINTS, weights, rate, **options)
            first, other = (np.unique(library.decode(made, w), axis=0) for w in (here, there))
            assert _alike(first, other)

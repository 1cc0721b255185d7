"""Learned codecs on a CUDA device: its code is run here on the CPU, and on CUDA where there is one.

What runs on a device is the models' own layers by PyTorch's functions, whatever the device is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from cloud_files.clouds import write_cloud
from pcc_networks.pcgcv1 import weights as pcgcv1_weights
from pcc_networks.pcgcv1.device_inference import DeviceTransforms
from pcc_networks.pcgcv2 import inference as pcgcv2_inference
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import Codec
from puckbench.codecs.registry import open_codec
from puckbench.jobs.train import Train
from tests.support.learned_codecs import changes, save_tiny, shell

CODECS = ("pcgcv1", "pcgcv1_plus", "pcgcv2", "pcgcv2_plus")
SHIPPED = ("pcgcv1_plus", "pcgcv2_plus", "pcgcv2_plus_rooms")
"""Codecs whose weights come with the program."""
cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights")
    for codec in CODECS:
        save_tiny(codec, path / f"{codec}.safetensors")
    return path


@pytest.fixture
def opened(folder: Path) -> Callable[..., Codec]:
    def open_one(name: str, **options: object) -> Codec:
        return open_codec(name, changes(name, folder / f"{name}.safetensors", **options))

    return open_one


@pytest.fixture
def own_layers(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Take the code of a device for codecs that are opened from then on, on the CPU."""

    def take() -> None:
        monkeypatch.setattr(pcgcv2_inference, "is_fused", lambda _: False)
        monkeypatch.setattr(pcgcv1_weights, "CpuTransforms", DeviceTransforms)

    return take


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether as many points lie where the other has one; few voxels are chosen by rounding."""
    near, _ = cKDTree(other).query(one)
    return len(one) == len(other) and bool(np.quantile(near, 0.98) < 0.01)


def _check_alike(
    name: str, stream: bytes, again: bytes, expected: np.ndarray, decoded: np.ndarray
) -> None:
    """That two ways of computing give the same stream and points, but for roundings."""
    result = np.unique(decoded, axis=0)
    # sums are rounded in another order
    assert abs(len(again) - len(stream)) <= max(2, 0.01 * len(stream))
    assert _alike(result, expected)


@pytest.mark.parametrize("name", CODECS)
def test_the_models_own_layers_code_as_the_fused_ones_do(
    name: str, opened: Callable[..., Codec], own_layers: Callable[[], None]
) -> None:
    points, fused = 40 + shell(), opened(name)
    streams = [fused.encode(points, rate) for rate in fused.rates]
    decoded = [np.unique(fused.decode(stream), axis=0) for stream in streams]
    own_layers()
    other = opened(name)
    for stream, expected, rate in zip(streams, decoded, other.rates, strict=True):
        _check_alike(name, stream, other.encode(points, rate), expected, other.decode(stream))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_weights_code_by_the_models_own_layers(
    name: str, own_layers: Callable[[], None]
) -> None:
    """At the lowest and the highest rate; the streams of either decode to the same surface."""
    points, fused = 40 + shell(), open_codec(name)
    rates = [next(iter(fused.rates)), list(fused.rates)[-1]]
    streams = [fused.encode(points, rate) for rate in rates]
    decoded = [np.unique(fused.decode(stream), axis=0) for stream in streams]
    own_layers()
    other = open_codec(name)
    for stream, expected, rate in zip(streams, decoded, rates, strict=True):
        _check_alike(name, stream, other.encode(points, rate), expected, other.decode(stream))


@pytest.mark.skipif(torch.cuda.is_available(), reason="for machines without CUDA")
@pytest.mark.parametrize("name", CODECS)
def test_where_there_is_no_cuda_the_codec_says_so(name: str, opened: Callable[..., Codec]) -> None:
    codec = opened(name, device="cuda")
    assert codec.available() == (False, "device cuda: PyTorch finds no CUDA device here")
    with pytest.raises(InputError, match="no CUDA device"):
        codec.encode(40 + shell(), "r1")


@pytest.mark.skipif(torch.cuda.is_available(), reason="for machines without CUDA")
@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"device": "cuda"}, "codec pcgcv2_plus: device cuda: PyTorch finds no CUDA device here"),
        ({"devise": "cuda"}, "codec pcgcv2_plus: unknown option 'devise'"),
    ],
)
def test_a_training_of_an_entry_that_cannot_be_used_does_not_start(
    options: dict[str, str], fault: str, tmp_path: Path
) -> None:
    write_cloud(tmp_path / "a.ply", PointCloud(shell(), about={"size": 64}))
    out = tmp_path / "out.safetensors"
    training = Train(codec="pcgcv2_plus", changes={"options": options}, options={"steps": 1})
    with pytest.raises(InputError, match=fault):
        training.run((tmp_path / "a.ply",), out)
    assert not out.exists()


@cuda
@pytest.mark.parametrize("name", CODECS)
def test_streams_decode_on_either_side(name: str, opened: Callable[..., Codec]) -> None:
    points, here, there = 40 + shell(), opened(name), opened(name, device="cuda")
    for rate in here.rates:
        stream, again = here.encode(points, rate), there.encode(points, rate)
        for made in (stream, again):
            first, other = (np.unique(codec.decode(made), axis=0) for codec in (here, there))
            assert _alike(first, other)

"""Each learned codec calls its network as its rates and options say."""

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

from cloud_files.clouds import read_cloud, write_cloud
from pcc_networks import lizip, octree_net, pcgcv1, pcgcv2, reno
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.registry import based_on, codec_class, codec_of, open_codec
from puckbench.steps.coding import ready
from puckbench.steps.weights import Train
from tests.support.codecs import decode, encode
from tests.support.learned_codecs import RATES, changes, reno_state, save_tiny, shell, weights_name

NETWORKS: dict[str, tuple[ModuleType, dict[str, Any], float]] = {
    "pcgcv1_plus": (pcgcv1, {"rate": 1}, 1.0),
    "pcgcv2_plus": (pcgcv2, {"rate": 1}, 1.0),
    "sparse_octree_net": (octree_net, {"scale": 1.0}, 1.0),
    "reno": (reno, {"posq": 1000.0}, 1000.0),
    "lizip": (lizip, {"step_m": 1.0}, 1.0),
}
"""Codec, its library, the arguments that are its rate r2, and the library's units per step."""
IMPROVED = ("pcgcv1_plus", "pcgcv2_plus")
METRES = 0.2 * shell()
pytestmark = pytest.mark.usefixtures("one_thread")
no_cuda = pytest.mark.skipif(torch.cuda.is_available(), reason="for machines without CUDA")


@pytest.mark.parametrize("name", NETWORKS)
def test_the_library_and_the_codec_make_the_same_stream(name: str, tmp_path: Path) -> None:
    library, rate, unit = NETWORKS[name]
    save_tiny(name, tmp_path / weights_name(name))
    weights = library.load_weights(tmp_path / weights_name(name))
    stream = library.encode(shell() * unit, weights, **rate)
    codec = open_codec(name, changes(name, tmp_path))
    assert encode(codec, shell(), "r2") == stream
    assert np.allclose(library.decode(stream, weights) / unit, decode(codec, stream))
    assert codec_of(stream) == name


def _plane(step: int) -> np.ndarray:
    axis = np.arange(0.0, 128, step)
    x, y = np.meshgrid(axis, axis)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def _published(name: str, weights: Path, rates: dict[str, Any] | None = None) -> Codec:
    """The codec that a changed one is based on, with the same weights."""
    base = based_on(open_codec(name))
    entry = changes(base, weights)
    return open_codec(base, entry if rates is None else {**entry, "rates": rates})


@pytest.mark.parametrize("name", IMPROVED)
def test_sparse_clouds_are_coded_on_a_coarser_grid_except_as_published(
    name: str, tmp_path: Path
) -> None:
    save_tiny(name, tmp_path / "tiny.safetensors")
    rates = {rate: {**values, "mean_occupied_children": 4} for rate, values in RATES[name].items()}
    entry = {**changes(name, tmp_path, point_reconstruction=False), "rates": rates}
    codec, points = open_codec(name, entry), _plane(2)
    decoded = decode(codec, encode(codec, points, "r2"))
    assert np.array_equal(np.unique(decoded % 2), [0])
    assert len(decoded) == len(points)
    published = _published(name, tmp_path, rates)
    stream = encode(published, points, "r2")
    assert set(np.unique(decode(published, stream) % 2)) == {0, 1}
    assert np.array_equal(decode(codec, stream), decode(published, stream))  # the stream says how


@pytest.mark.parametrize("name", IMPROVED)
def test_coordinates_are_truncated_as_published(name: str, tmp_path: Path) -> None:
    save_tiny(name, tmp_path / "tiny.safetensors")
    points = _plane(2) + np.arange(3)
    rounded = open_codec(name, changes(name, tmp_path))
    published = _published(name, tmp_path)
    assert encode(published, points + 0.9, "r2") == encode(published, points, "r2")
    assert encode(rounded, points + 0.9, "r2") != encode(rounded, points, "r2")


@pytest.mark.parametrize("name", IMPROVED)
def test_options_choose_context_mixing_and_point_reconstruction(name: str, tmp_path: Path) -> None:
    save_tiny(name, tmp_path / "tiny.safetensors")
    points = _plane(1)[::2]
    for option in ("context_mixing", "point_reconstruction"):
        streams = [
            encode(open_codec(name, changes(name, tmp_path, **{option: value})), points, "r1")
            for value in (True, False)
        ]
        assert streams[0] != streams[1]


def test_pcc_arenas_rates() -> None:
    rates = codec_class("pcgcv1").rates.values()
    assert [(r["lmbda"], r["scale"], r["rho"]) for r in rates] == [
        (0.75, 0.625, 1.15), (0.75, 1, 1.15), (2, 1, 1), (3.5, 1, 1), (6, 1, 1), (10, 1, 1),
    ]  # fmt: skip


def test_the_rate_that_the_authors_weights_lack_is_named(tmp_path: Path) -> None:
    for alpha in ("0.75", "2", "6", "10"):
        (tmp_path / f"a{alpha}b3.npz").touch()
    options = {"options": {"weights": str(tmp_path)}}
    why = why_not_here(open_codec("pcgcv1", options))
    assert "no weights for r4 (rates it has: r1, r2, r3, r5, r6)" in why
    rest = {**options, "rates": ["r1", "r2", "r3", "r5", "r6"]}
    assert not why_not_here(open_codec("pcgcv1", rest))


@pytest.mark.parametrize(
    ("name", "entry", "fault"),
    [
        ("pcgcv2_plus", {"options": {"weights": "nowhere"}}, "no such folder"),
        ("pcgcv2_plus", {"options": {"weights": "."}, "rates": ["r1"]}, "no file of weights of"),
        ("sparse_octree_net", {"options": {"weights": "."}}, "has no file of weights"),
        ("reno", {"options": {"weights": "."}}, ". has no file of weights of reno: fetch them"),
        ("reno", {}, "no weights in data/reno_weights: fetch them (puckbench data reno_weights)"),
        ("lizip", {}, "no weights in data/lizip_weights: fetch them"),
        ("lizip", {"options": {"weights": "."}}, ". has no file of weights of lizip: fetch them"),
    ],
)
def test_missing_weights_are_named(
    name: str, entry: dict[str, Any], fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    why = why_not_here(open_codec(name, entry))
    assert fault in why


@pytest.mark.parametrize("name", ["pcgcv2_plus", "sparse_octree_net"])
def test_the_command_decodes_with_the_weights_that_it_is_given(name: str, tmp_path: Path) -> None:
    save_tiny(name, tmp_path / "tiny.safetensors")
    codec = open_codec(name, changes(name, tmp_path))
    stream = encode(codec, shell(), "r1")
    (tmp_path / "a.bin").write_bytes(stream)
    words = ["decode", tmp_path / "a.bin", tmp_path / "a.ply", "--weights", tmp_path]
    entry = json.dumps({"rates": RATES[name]})
    command = [sys.executable, "-m", "puckbench", *words, "--entry", entry]
    subprocess.run(command, check=True)
    assert np.array_equal(read_cloud(tmp_path / "a.ply").xyz, decode(codec, stream))


@pytest.fixture(scope="module")
def reno_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the authors' weights come in."""
    path = tmp_path_factory.mktemp("reno")
    for seed, name in enumerate(("KITTIDetection", "SemanticKITTI", "Ford")):
        torch.save(reno_state(seed=seed), path / f"{name}.pt")
    return path


def _reno(weights: Path, **options: Any) -> Codec:
    return open_codec("reno", {"options": {"weights": str(weights), **options}})


def test_one_of_renos_three_sets_codes_and_all_decode(reno_folder: Path) -> None:
    streams, codec = {}, _reno(reno_folder)
    for name in ("KITTIDetection", "SemanticKITTI", "Ford"):
        own = _reno(reno_folder, trained_on=name)
        assert not why_not_here(own)
        assert own.weights("8mm") == reno_folder / f"{name}.pt"
        streams[name] = encode(own, METRES, "64mm")
        assert streams[name] == encode(_reno(reno_folder / f"{name}.pt"), METRES, "64mm")
        assert len(decode(codec, streams[name])) == len(decode(codec, streams["KITTIDetection"]))
    assert len(set(streams.values())) == 3
    alone = _reno(reno_folder / "Ford.pt")
    with pytest.raises(InputError, match="made with other weights"):
        decode(alone, streams["SemanticKITTI"])


@pytest.mark.parametrize("rate", ["4mm", "64mm", "512mm"])
def test_points_of_reno_are_those_of_gpcc(reno_folder: Path, rate: str) -> None:
    points = np.random.default_rng(2).normal(size=(700, 3)) * [40, 30, 2]
    codec = _reno(reno_folder)
    length = float(rate[:-2]) / 1000
    gpcc = open_codec("gpcc", {"metric_rates": {rate: {"step_m": length}}})
    result, expected = (decode(each, encode(each, points, rate)) for each in (codec, gpcc))
    order, expected_order = (np.lexsort(np.rint(p * 1e6).T) for p in (result, expected))
    np.testing.assert_allclose(result[order], expected[expected_order], atol=1e-9)
    assert list(codec.rates) == [f"{1 << n}mm" for n in range(9, 1, -1)]
    fault = codec.skip(CloudKind("scaled"), "8mm")
    assert str(fault).startswith("rates such as 512mm are lengths, and the cloud is")


@no_cuda
@pytest.mark.parametrize("name", ["pcgcv1", "pcgcv1_plus", "pcgcv2", "pcgcv2_plus"])
def test_where_there_is_no_cuda_the_codec_says_so(name: str, tmp_path: Path) -> None:
    save_tiny(name, tmp_path / "tiny.safetensors")
    codec = open_codec(name, changes(name, tmp_path, device="cuda"))
    with pytest.raises(InputError, match="device cuda: PyTorch finds no CUDA device here"):
        ready(codec)
    with pytest.raises(InputError, match="no CUDA device"):
        encode(codec, shell(), "r1")


@no_cuda
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
    training = Train(codec="pcgcv2_plus", entry={"options": options}, options={"steps": 1})
    with pytest.raises(InputError, match=fault):
        training.run((tmp_path / "a.ply",), out)
    assert not out.exists()

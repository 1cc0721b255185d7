"""RENO with random weights: its network, its range coder, and its stream."""

import os
import subprocess
import sys
import zlib
from dataclasses import replace
from fractions import Fraction
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn import functional

from gpcc import decode_geometry, encode_geometry
from pcc_networks.exponential import exponential
from pcc_networks.range_coder import decode_symbols, encode_symbols
from pcc_networks.reno import codec as coder_module
from pcc_networks.reno.codec import OFFSET, decode, decode_tree, encode, encode_tree
from pcc_networks.reno.inference import (
    convolution,
    cumulate,
    head,
    predicted,
    prior_features,
    target_features,
)
from pcc_networks.reno.stream import read_stream, write_stream
from pcc_networks.reno.weights import RenoWeights, load_weights
from pcc_networks.sparse.thread_pool import thread_pool
from pcc_networks.sparse.voxels import morton_keys, morton_voxels, parents_of, pyramid
from pointkit.errors import InputError
from tests.support.learned_codecs import endure_damage, reno_state, sealed, shell, torch_threads

MILLIMETRES = 200.0 * shell()
KEYS = np.unique(morton_keys(shell().astype(np.int64) + 64))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as the authors' weights come in."""
    path = tmp_path_factory.mktemp("reno")
    for seed, name in enumerate(("KITTIDetection", "SemanticKITTI", "Ford")):
        torch.save(reno_state(seed=seed), path / f"{name}.pt")
    return path


@pytest.fixture(scope="module")
def weights(folder: Path) -> RenoWeights:
    return load_weights(folder / "KITTIDetection.pt")


class Reference:
    """The authors' network in PyTorch's doubles, with neighbours found in a dictionary."""

    def __init__(self, state: dict[str, torch.Tensor]) -> None:
        self.state = {name: value.double() for name, value in state.items()}

    def convolution(
        self, voxels: list[tuple[int, ...]], features: torch.Tensor, name: str
    ) -> torch.Tensor:
        rows = {voxel: row for row, voxel in enumerate(voxels)}
        made = torch.zeros_like(features)
        steps = [(x, y, z) for z in (-1, 0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1)]
        for row, voxel in enumerate(voxels):
            for kernel, step in zip(self.state[f"{name}.kernel"], steps, strict=True):
                other = rows.get(tuple(np.add(voxel, step)))
                if other is not None:
                    made[row] += features[other] @ kernel
        return made

    def network(
        self, voxels: list[tuple[int, ...]], features: torch.Tensor, name: str
    ) -> torch.Tensor:
        features = self.convolution(voxels, features, f"{name}.0").relu()
        for block in ("2", "3"):
            inner = self.convolution(voxels, features, f"{name}.{block}.conv0").relu()
            outer = self.convolution(voxels, inner, f"{name}.{block}.conv1")
            features = (outer + features).relu()
        return features

    def head(self, features: torch.Tensor, name: str) -> torch.Tensor:
        state = self.state
        hidden = features @ state[f"{name}.0.weight"].T + state[f"{name}.0.bias"]
        logits = hidden.relu() @ state[f"{name}.2.weight"].T + state[f"{name}.2.bias"]
        return functional.softmax(logits, dim=1)


def _level(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The next coarser voxels, and which of their children are occupied."""
    coarser = np.unique(keys >> 3)
    occupancy = [sum(1 << int(k & 7) for k in keys if k >> 3 == parent) for parent in coarser]
    return coarser, np.array(occupancy, np.uint8)


def test_the_network_is_the_authors(folder: Path) -> None:
    fine, occupancy = _level(KEYS[:500])
    coarse, above = _level(fine)
    reference = Reference(reno_state())
    embedded = reference.state["prior_embedding.weight"][above.astype(int)]
    voxels = [tuple(map(int, voxel)) for voxel in morton_voxels(coarse)]
    prior = reference.network(voxels, embedded, "prior_resnet")
    parent = np.searchsorted(coarse, fine >> 3)
    child = reference.state["target_embedding.target_res_embedding.weight"][fine & 7]
    voxels = [tuple(map(int, voxel)) for voxel in morton_voxels(fine)]
    target = reference.network(voxels, prior[parent] + child, "target_resnet")
    first = occupancy % 16
    emphasised = target + reference.state["pred_head_s1_emb.weight"][first.astype(int)]
    expected = [reference.head(target, "pred_head_s0"), reference.head(emphasised, "pred_head_s1")]

    weights = load_weights(folder / "KITTIDetection.pt")
    sets, child_maps = pyramid(fine, 1)
    with thread_pool(2) as pool:
        features = prior_features(weights, above, sets[1].neighbours, pool)
        features = target_features(weights, features, child_maps[0].slots, sets[0].neighbours, pool)
        result = [predicted(weights, 0, features, pool)]
        result.append(predicted(weights, 1, features, pool, first))
    for probabilities, cumulative in zip(expected, result, strict=True):
        exact = np.concatenate([np.zeros((len(fine), 1)), probabilities.cumsum(1).numpy()], axis=1)
        assert np.abs(exact * 65520 + np.arange(17) - cumulative).max() < 1.5
        assert (np.diff(cumulative, axis=1) > 0).all()
        assert probabilities.max() > 0.5  # it does predict something


def test_a_convolution_is_fused_multiplications_in_their_order() -> None:
    """Exact fractions rounded once a step: what IEEE 754 asks of every machine."""
    rng = np.random.default_rng(3)
    keys = morton_keys(np.argwhere(np.ones((3, 3, 3)))[rng.permutation(27)[:13]])
    table = pyramid(np.sort(keys), 0)[0][0].neighbours
    features, added = rng.normal(size=(2, 13, 4)).astype(np.float32)
    kernel = rng.normal(size=(27, 4, 4)).astype(np.float32)
    made = np.empty(13 * 4, np.float32)
    convolution(4)(table, features.ravel(), kernel.ravel(), added.ravel(), 0, 13, made)
    for row, out in np.ndindex(13, 4):
        total = added[row, out]
        for offset in np.flatnonzero(table[:, row] >= 0):
            for channel in range(4):
                read = features[table[offset, row], channel]
                total = _fused(read, kernel[offset, channel, out], total)
        assert made[4 * row + out] == max(total, np.float32(0))


def _fused(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    exact = Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c))
    near = np.float32(float(exact))
    around = [near, np.nextafter(near, np.float32(np.inf)), np.nextafter(near, -np.float32(np.inf))]
    return min(
        around, key=lambda value: (abs(Fraction(float(value)) - exact), value.view("u4") & 1)
    )


def test_the_exponential_is_that_of_the_library() -> None:
    x = -np.concatenate([[0.0], np.geomspace(1e-9, 43.9, 500)])
    np.testing.assert_allclose([exponential(each) for each in x], np.exp(x), rtol=1e-14)
    assert exponential(-44.0) == exponential(-1e300) == 0
    assert np.isnan(exponential(np.nan))
    assert np.isnan(exponential(-np.inf))


def _cumulative(logits: np.ndarray) -> np.ndarray:
    result = np.empty((len(logits), 17), np.int32)
    for row, into in zip(logits.astype(np.float32), result, strict=True):
        cumulate(row, 0, into)
    return result


def test_frequencies_are_rounded_as_the_authors_round_them() -> None:
    logits = np.random.default_rng(0).normal(size=(200, 16)).astype(np.float32) * 3
    shares = torch.from_numpy(logits).softmax(-1).cumsum(-1)
    expected = (shares * (2**16 - 16)).round().to(torch.int64).numpy() + np.arange(1, 17)
    difference = expected - _cumulative(logits)[:, 1:]
    assert np.abs(difference).max() <= 1
    assert np.abs(difference).mean() < 0.01


@pytest.mark.parametrize("fault", [np.nan, np.inf, -np.inf])
def test_logits_that_are_no_numbers_give_equal_frequencies(fault: float) -> None:
    logits = np.zeros((1, 16))
    logits[0, 5] = fault
    assert (np.diff(_cumulative(logits)) == 4096).all()


def test_the_range_coder_writes_what_torchac_writes() -> None:
    """Bytes of torchac 0.9.3 for the same symbols and frequencies."""
    rng = np.random.default_rng(7)
    steps = rng.integers(1, 4096, (40, 16))
    steps[:, 3] += 65536 - steps.sum(axis=1)
    cumulative = np.concatenate([np.zeros((40, 1)), steps.cumsum(axis=1)], axis=1).astype(np.int32)
    symbols = rng.integers(0, 16, 40).astype(np.uint8)
    data = encode_symbols(symbols, cumulative)
    assert data.hex() == TORCHAC
    assert np.array_equal(decode_symbols(data, cumulative), symbols)
    for damaged in (data[:-1], data + b"\0", b""):
        with pytest.raises(InputError, match="its symbols"):
            decode_symbols(damaged, cumulative)


TORCHAC = "f29cfadea1d37b3090967f769513ceb1cf66dacadaf96b88a3"


def test_symbols_take_their_ideal_length() -> None:
    rng = np.random.default_rng(0)
    cumulative = _cumulative(rng.normal(size=(3000, 16)) * 4)
    symbols = np.array([rng.choice(16, p=np.diff(row) / 65536) for row in cumulative], np.uint8)
    rows = np.arange(3000)
    shares = (cumulative[rows, symbols + 1] - cumulative[rows, symbols]) / 65536
    data = encode_symbols(symbols, cumulative)
    assert 0 <= 8 * len(data) + np.log2(shares).sum() < 16
    assert np.array_equal(decode_symbols(data, cumulative), symbols)


@pytest.mark.parametrize("posq", [1, 4, 64, 512])
def test_points_are_those_of_gpcc(weights: RenoWeights, posq: int) -> None:
    points = np.random.default_rng(2).normal(size=(700, 3)) * [40_000, 30_000, 2000]
    result = decode(encode(points, weights, posq), weights)
    steps = np.rint((points + OFFSET) / posq).astype(np.int64)
    expected = decode_geometry(encode_geometry(steps)).positions() * posq - OFFSET
    np.testing.assert_allclose(_sorted(result), _sorted(expected), atol=1e-6)


def _sorted(points: np.ndarray) -> np.ndarray:
    steps = np.rint(points * 1e3)
    return points[np.lexsort(steps.T)]


@pytest.mark.parametrize(
    "points",
    [[[0.0, 0, 0]], [[130.0, -131, 0.5], [0, 0, 0]], [[400.0, 1, 2], [-900, 0, 7]],
     [[9000.0, 0, 0], [9400, 100, 0]]],
    ids=["one", "near", "beyond", "far"],
)  # fmt: skip
def test_clouds_beyond_the_authors_grid_come_back(
    weights: RenoWeights, points: list[list[float]]
) -> None:
    cloud = 1000 * np.array(points)
    result = decode(encode(cloud, weights, 8), weights)
    assert np.abs(_sorted(result) - _sorted(cloud)).max() <= 4 + 1e-6


def test_values_that_the_stream_cannot_hold_are_refused(weights: RenoWeights) -> None:
    with pytest.raises(InputError, match="needs more than 20 bits per coordinate at posQ 8"):
        encode(np.array([[0.0, 0, 0], [9e6, 0, 0]]), weights, 8)
    with pytest.raises(InputError, match=r"posQ 4097 is not a number in half precision"):
        encode(MILLIMETRES, weights, 4097)


def test_streams_are_the_same_with_any_number_of_threads(weights: RenoWeights) -> None:
    """And on any machine: of these weights, which NumPy makes, the bytes are known."""
    streams = []
    for threads in (1, 3):
        with torch_threads(threads):
            streams.append(encode(MILLIMETRES, weights, 64))
    stream = streams[0]
    assert streams[1] == stream
    tree = read_stream(stream).tree
    assert sha256(b"".join(tree.symbols)).hexdigest()[:16] == KNOWN


KNOWN = "06bedb367ad9ec07"


def check_of_layers() -> int:
    """A number that tells one bit more or less in a convolution, or in a head."""
    rng = np.random.default_rng(0)
    table = rng.integers(-300, 300, (27, 300)).astype(np.int32)
    features, made = rng.normal(size=(2, 300 * 8)).astype(np.float32)
    kernel, last, bias = (
        rng.normal(size=size).astype(np.float32) for size in (27 * 64, 8 * 16, 16)
    )
    convolution(8)(table, features, kernel, features, 0, 300, made)
    result, symbols = np.empty((300, 17), np.int32), rng.integers(0, 16, 300).astype(np.uint8)
    head(8)(made, 0, 300, kernel[:64], bias[:8], last, bias, last, symbols, result)
    return zlib.crc32(result, zlib.crc32(made))


def test_a_machine_without_fused_multiplications_computes_the_same() -> None:
    """Then a library does them."""
    generic = {**os.environ, "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    program = "from tests.pcc_networks.test_reno import check_of_layers; print(check_of_layers())"
    root = Path(__file__).parents[2]
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, check=True, env=generic, cwd=root, capture_output=True)
    assert int(done.stdout) == check_of_layers()


def test_a_machine_that_computes_otherwise_says_so(
    weights: RenoWeights, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = encode(MILLIMETRES, weights, 32)
    real, calls = coder_module.predicted, []

    def otherwise(*arguments: Any) -> np.ndarray:
        made = real(*arguments).copy()
        calls.append(made)
        if len(calls) == 7:
            made[len(made) // 2, 1:16] += 1
        return made

    monkeypatch.setattr(coder_module, "predicted", otherwise)
    with pytest.raises(InputError, match="this machine does not compute as the encoder's did"):
        decode(stream, weights)
    assert len(calls) >= 7


def test_each_damage_ends_in_one_error(weights: RenoWeights) -> None:
    stream = encode(MILLIMETRES, weights, 512)
    endure_damage(lambda damaged: decode(damaged, weights), stream, 5, seed=1)
    coded = read_stream(stream)
    tree = coded.tree
    for changed, fault in (
        (replace(tree, count=tree.count + 1), "this machine does not compute"),
        (replace(tree, check=tree.check ^ 1), "this machine does not compute"),
        (replace(tree, symbols=tree.symbols[:-1]), "its base"),
        (replace(tree, symbols=(b"",) * 40), "its base"),
        (replace(tree, base=tree.base[::-1]), "its base"),
        (replace(tree, base=tree.base - 2**20), "its base"),
        (replace(tree, occupancy=0 * tree.occupancy), "its base"),
        (replace(tree, base=np.repeat(tree.base, 64, axis=0)), "its header"),
    ):
        with pytest.raises(InputError, match=fault):
            decode(write_stream(replace(coded, tree=changed)), weights)
    with pytest.raises(InputError, match="its header"):
        decode(write_stream(replace(coded, posq=float("nan"))), weights)
    with pytest.raises(InputError, match="its length"):
        decode(sealed(stream + b"!", 5), weights)


def test_what_a_decoder_would_refuse_is_not_encoded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = load_weights(folder / "Ford.pt")
    assert np.array_equal(decode_tree(encode_tree(KEYS, weights), weights), KEYS)
    monkeypatch.setattr(coder_module, "MAX_LEVEL", len(parents_of(KEYS)[0]) - 1)
    with pytest.raises(InputError, match=r"more than \d+ voxels"):
        encode_tree(KEYS, weights)


def test_foreign_weights_are_named(tmp_path: Path, folder: Path) -> None:
    state = torch.load(folder / "Ford.pt")
    faults: dict[str, Any] = {
        "less": {name: value for name, value in state.items() if name != "pred_head_s0.0.bias"},
        "shape": state | {"pred_head_s0.0.bias": torch.zeros(9)},
        "infinite": state | {"pred_head_s0.0.bias": torch.full((8,), torch.inf)},
        "wide": {"prior_embedding.weight": torch.zeros(256, 257)},
        "other": {"prior_embedding.weight": 3},
    }
    for name, value in faults.items():
        torch.save(value, tmp_path / f"{name}.pt")
    (tmp_path / "text.pt").write_text("text")
    for name in (*faults, "text"):
        with pytest.raises(InputError, match=rf"{name}\.pt: not a checkpoint of RENO") as raised:
            load_weights(tmp_path / f"{name}.pt")
        assert "\n" not in str(raised.value)

"""The sparse octree net with random weights: properties that hold for all weights."""

import struct
import zlib
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcc import decode_geometry, encode_geometry
from gpcc.grid import input_grid
from pcc_networks.octree_net.codec import decode, decode_part, encode, encode_part, split
from pcc_networks.octree_net.mixing import code_symbols
from pcc_networks.octree_net.model import UNITS, WEIGHT_UNITS, OctreeNet, OctreeNetShape
from pcc_networks.octree_net.stream import OctreeNetStream, read_stream, write_stream
from pcc_networks.octree_net.symbols import EVEN, ODD, groups_of, slots_of, symbols_of
from pcc_networks.octree_net.training import bits_per_level
from pcc_networks.octree_net.weights import OctreeNetWeights, load_weights, save_weights
from pcc_networks.sparse.thread_pool import thread_pool
from pcc_networks.sparse.voxels import morton_keys, morton_voxels
from pointkit.errors import InputError
from tests.support.learned_codecs import frequencies, octree_network, save_tiny, torch_threads


def _shell(points: int = 6000) -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(points, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return 40 + directions * [30, 22, 12]


KEYS = np.unique(morton_keys(np.rint(_shell()).astype(np.int64)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("folder")
    save_tiny("sparse_octree_net", path / "tiny.safetensors")
    return path


@pytest.fixture(scope="module")
def weights(folder: Path) -> OctreeNetWeights:
    return load_weights(folder / "tiny.safetensors")


def test_symbols_hold_the_children() -> None:
    first, second = symbols_of(KEYS)
    parents = np.unique(KEYS >> 3)
    slots = slots_of(first, second)
    assert np.array_equal(parents[slots >> 3] << 3 | slots & 7, KEYS)


def test_faces_join_the_two_halves() -> None:
    for child in range(8):
        for axis in range(3):
            assert (child in EVEN) != (child ^ 1 << axis in EVEN)
    assert sorted(EVEN + ODD) == list(range(8))


def test_a_square_on_an_axis_plane_has_one_voxel_of_each_group() -> None:
    keys = np.arange(8)
    group = np.empty(8, dtype=int)
    for number, rows in enumerate(groups_of(keys)):
        group[rows] = number
    for axis in range(3):
        for side in (0, 1):
            assert sorted(group[(keys >> axis & 1) == side]) == [0, 1, 2, 3]


Step = tuple[list[np.ndarray], np.ndarray]


class IntegerNetwork:
    """The network in 64-bit integers of NumPy, with a dictionary of neighbours."""

    def __init__(self, model: OctreeNet) -> None:
        self.values = {
            name: np.rint(
                value.double().numpy() * (WEIGHT_UNITS if name.endswith("kernel") else UNITS)
            ).astype(np.int64)
            for name, value in model.state_dict().items()
        }

    def _sums(self, made: np.ndarray, name: str) -> np.ndarray:
        """With the bias, rounded to whole units, ties to even."""
        units, rest = np.divmod(made + self.values[f"{name}.bias"] * WEIGHT_UNITS, WEIGHT_UNITS)
        half = WEIGHT_UNITS // 2
        return units + ((rest > half) | ((rest == half) & (units % 2 == 1)))

    def _rows(self, read: np.ndarray, name: str, child: int = 0) -> np.ndarray:
        return self._sums(read.clip(0, 255) @ self.values[f"{name}.kernel"][child], name)

    def _around(self, features: np.ndarray, name: str, voxels: np.ndarray) -> np.ndarray:
        at = {tuple(voxel): row for row, voxel in enumerate(voxels.tolist())}
        made = np.zeros_like(features)
        read = features.clip(0, 255)
        for row, (x, y, z) in enumerate(voxels.tolist()):
            for offset in range(27):
                step = (x + offset % 3 - 1, y + offset // 3 % 3 - 1, z + offset // 9 - 1)
                if step in at:
                    made[row] += read[at[step]] @ self.values[f"{name}.kernel"][offset]
        return self._sums(made + features * WEIGHT_UNITS, name)

    def _head(self, features: np.ndarray, name: str) -> np.ndarray:
        return self._rows(self._rows(features, f"{name}.hidden"), f"{name}.logits")

    def level(self, own: np.ndarray, below: np.ndarray, features: np.ndarray) -> Step:
        """Logits of a level's groups and symbols, and the features of its children."""
        voxels, (first, second), logits = morton_voxels(own), symbols_of(below), []
        features = self._around(features, "convolutions.0", voxels)
        corner = own & 7
        for group, corners in enumerate([(0, 7), (1, 6), (2, 5), (3, 4)]):
            rows = np.isin(corner, corners)
            around = f"group_convolutions.{group - 1}"
            original = (self._around(features, around, voxels) if group else features)[rows]
            logits.append(self._head(original, f"first_heads.{group}"))
            original = original + self.values["first_embedding"][first[rows]]
            logits.append(self._head(original, f"second_heads.{group}"))
            features[rows] = original + self.values["second_embedding"][second[rows]]
        parent = np.searchsorted(own, below >> 3)
        pairs = zip(parent, below & 7, strict=True)
        return logits, np.stack(
            [self._rows(features[p], "upsampling", child) for p, child in pairs]
        )

    def frequencies(self, keys: np.ndarray, levels: int) -> list[np.ndarray]:
        """Frequencies of every run of symbols, in the order in which they are coded."""
        sets = [keys]
        for _ in range(levels):
            sets.append(np.unique(sets[-1] >> 3))
        features = np.repeat(self.values["root"][None], len(sets[-1]), axis=0)
        result = []
        for below, own in zip(sets[-2::-1], sets[:0:-1], strict=True):
            logits, features = self.level(own, below, features)
            result += [frequencies((units / UNITS).astype(np.float32)) for units in logits]
        return result


def _coded_frequencies(model: OctreeNet, keys: np.ndarray) -> list[np.ndarray]:
    """Frequencies that the network predicts for each run of symbols."""
    runs = []

    def noted(*run: Any) -> None:
        runs.append(run[-1])
        code_symbols(*run)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pcc_networks.octree_net.codec.code_symbols", noted)
        encode_part(keys, model)
    return runs


def test_the_network_is_the_same_in_integers(folder: Path) -> None:
    model = load_weights(folder / "tiny.safetensors").model
    runs = _coded_frequencies(model, KEYS)
    whole = IntegerNetwork(model).frequencies(KEYS, encode_part(KEYS, model).levels)
    assert len(runs) == len(whole) > 16
    for result, expected in zip(runs, whole, strict=True):
        assert np.array_equal(result, expected)


def test_frequencies_are_rounded_powers_of_two() -> None:
    logits = np.array([[0.0, -1.0, -2.5, -40.0] + [-13.0] * 12], dtype=np.float32)
    expected = [65536, 32768, round(65536 / 2**2.5), 8, *[8] * 12]
    assert frequencies(logits)[0].tolist() == expected
    assert frequencies(logits + 7)[0].tolist() == expected


def test_threads_change_neither_bytes_nor_voxels() -> None:
    model = octree_network(OctreeNetShape(channels=32))
    parts = []
    for threads in (1, 2, 3):
        with torch_threads(threads):
            parts.append(encode_part(KEYS, model))
            assert np.array_equal(decode_part(parts[0], model), KEYS)
    assert parts[0] == parts[1] == parts[2]


def test_training_counts_the_bits_that_the_network_predicts() -> None:
    model = octree_network()
    runs, levels = _coded_frequencies(model, KEYS), encode_part(KEYS, model).levels
    sets = [KEYS]
    for _ in range(levels):
        sets.append(np.unique(sets[-1] >> 3))
    symbols = chain.from_iterable(
        (half[rows] for rows in groups_of(own) if len(rows) for half in symbols_of(below))
        for own, below in zip(sets[:0:-1], sets[-2::-1], strict=True)
    )
    said = sum(
        np.log2(run.sum(axis=1) / run[np.arange(len(run)), of_run]).sum()
        for run, of_run in zip(runs, symbols, strict=True)
    )
    with thread_pool(1) as pool:
        bits = float(sum(bits_per_level(model, KEYS, levels, pool)))
    assert said == pytest.approx(bits, rel=0.01)


def test_contexts_learn_the_statistics_of_a_cloud() -> None:
    model = octree_network()
    part = encode_part(KEYS, model)
    with thread_pool(1) as pool:
        bits = float(sum(bits_per_level(model, KEYS, part.levels, pool)))
    assert 8 * len(part.symbols) < 0.75 * bits


def _sorted(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(np.rint(points * 1e6).T)]


@pytest.mark.parametrize("scale", [0.125, 0.375, 1])
def test_decoded_points_are_those_of_gpcc(weights: OctreeNetWeights, scale: float) -> None:
    points = _shell(800)
    result = decode(encode(points, weights, scale), weights)
    stream = encode_geometry(np.rint(points * scale).astype(np.int64), scale=scale)
    expected = decode_geometry(stream).positions()
    np.testing.assert_allclose(_sorted(result), _sorted(expected), rtol=1e-12)


SPECIAL = {
    "one point": np.array([[3.0, 2.0, 1.0]]),
    "duplicates": np.repeat([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 80, axis=0),
    "scattered": np.random.default_rng(3).integers(-50_000, 50_000, (300, 3)).astype(float),
    "far away": 1e12 + 1e3 * np.arange(300.0).reshape(100, 3),
}


@pytest.mark.parametrize("name", SPECIAL)
def test_special_clouds_come_back(weights: OctreeNetWeights, name: str) -> None:
    points = np.unique(SPECIAL[name], axis=0)
    grid = input_grid(points, unit=1.0, scale=1.0)
    decoded = decode(encode(SPECIAL[name], weights, grid=grid), weights)
    assert np.array_equal(_sorted(decoded), _sorted(points))


def test_a_cloud_that_spans_too_much_is_refused(weights: OctreeNetWeights) -> None:
    with pytest.raises(InputError, match="spans more than 20 bits"):
        encode(np.array([[0.0, 0, 0], [1.5e6, 0, 0]]), weights)


def test_large_clouds_are_cut_into_parts() -> None:
    parts = split(KEYS, 1000)
    assert [len(part) for part in parts[:-1]] == [1000] * (len(parts) - 1)
    model = octree_network()
    decoded = [decode_part(encode_part(part, model), model) for part in parts]
    assert np.array_equal(np.concatenate(decoded), KEYS)


def test_weights_come_back_as_they_were_used(folder: Path) -> None:
    model, loaded = octree_network(), load_weights(folder / "tiny.safetensors")
    assert loaded.card == {"data": "none"}
    assert encode_part(KEYS, model) == encode_part(KEYS, loaded.model)


def test_weights_whose_sums_might_not_be_exact_are_refused(tmp_path: Path) -> None:
    model = octree_network()
    model.convolutions[0].kernel[:] = 2.0
    with pytest.raises(InputError, match="too large for exact sums"):
        save_weights(tmp_path / "a.safetensors", model, {})


def test_damaged_weights_are_refused(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "tiny.safetensors").read_bytes()
    for name, data in {
        "cut": whole[:-2],
        "shape": whole.replace(rb"channels\": 8", rb"channels\": 9"),
    }.items():
        (tmp_path / f"{name}.safetensors").write_bytes(data)
        with pytest.raises(InputError, match="damaged weights"):
            load_weights(tmp_path / f"{name}.safetensors")


def _checked(body: bytes, stream: bytes) -> bytes:
    """A body with a CRC that fits, behind the start of a stream."""
    return stream[:5] + struct.pack("<I", zlib.crc32(body)) + body


@settings(max_examples=150)
@given(data=st.data(), checked=st.booleans())
def test_damaged_streams_end_in_one_clean_error_or_points(
    weights: OctreeNetWeights, data: st.DataObject, checked: bool
) -> None:
    stream = encode(_shell(300), weights, 0.625)
    body = bytearray(stream[9:][: data.draw(st.integers(0, len(stream)))])
    for _ in range(data.draw(st.integers(1, 4))):
        if body:
            body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    damaged = _checked(bytes(body), stream) if checked else stream[:9] + bytes(body)
    with suppress(InputError):
        decoded = decode(damaged, weights)
        assert np.isfinite(decoded).all()


def _coded(weights: OctreeNetWeights) -> OctreeNetStream:
    return read_stream(encode(_shell(300), weights, 0.625))


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"count": 2**22}, "too many voxels"),
        ({"count": 5}, "number of voxels"),
        ({"count": 65_000}, "damaged"),
        ({"levels": 19}, "top level"),
        ({"top": b""}, "top level"),
        ({"symbols": b"\0" * 4000}, "damaged"),
    ],
)
def test_a_stream_with_impossible_numbers_is_refused(
    weights: OctreeNetWeights, change: dict, fault: str
) -> None:
    coded = _coded(weights)
    lying = replace(coded, parts=(replace(coded.parts[0], **change),))
    with pytest.raises(InputError, match=fault):
        decode(write_stream(replace(coded, parts=lying.parts)), weights)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf"), 5e-324, 1e-300])
def test_a_stream_without_a_scale_is_refused(weights: OctreeNetWeights, scale: float) -> None:
    with pytest.raises(InputError, match="scale"):
        decode(write_stream(replace(_coded(weights), scale=scale)), weights)

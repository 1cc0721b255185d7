"""PoLoPCAC with random weights: its network, its distributions, its order, and its stream."""

import os
import subprocess
import sys
import zlib
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from torch.nn import functional

from pcc_networks.polopcac import stream as stream_module
from pcc_networks.polopcac.attributes import KINDS, coded, uncoded
from pcc_networks.polopcac.codec import decode, encode
from pcc_networks.polopcac.distributions import (
    cumulative,
    decode_values,
    encode_values,
    laplace,
)
from pcc_networks.polopcac.fixed_point import STEP, applied, fixed_linear
from pcc_networks.polopcac.grouping import first_group, groups, shuffled
from pcc_networks.polopcac.inference import predicted
from pcc_networks.polopcac.neighbours import nearest
from pcc_networks.polopcac.stream import (
    CodedAttribute,
    attribute_bytes,
    read_stream,
    write_stream,
)
from pcc_networks.polopcac.weights import PolopcacWeights, load_weights
from pcc_networks.range_coder import encode_symbols
from pcc_networks.sparse.thread_pool import thread_pool
from pointkit.errors import InputError
from tests.support.learned_codecs import polopcac_state, save_tiny, torch_threads

Attributes = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> PolopcacWeights:
    path = tmp_path_factory.mktemp("polopcac") / "ckpt.pt"
    save_tiny("polopcac", path)
    return load_weights(path)


def _cloud(points: int = 3000, seed: int = 0) -> tuple[np.ndarray, Attributes]:
    """A wavy surface with equal points, and attributes that vary along it."""
    rng = np.random.default_rng(seed)
    x, y = rng.integers(-60, 60, (2, points))
    positions = np.column_stack([x, y, np.rint(9 * np.sin(x / 9))]).astype(np.int64)
    grey = 120 + 60 * np.sin(x / 15) + rng.normal(0, 3, points)
    colours = np.clip(np.rint(grey[:, None] + [0, 20, -40]), 0, 255).astype(np.uint8)
    return positions, {"reflectance": np.rint(grey / 4).astype(np.uint8), "colour": colours}


def _rows(positions: np.ndarray, attributes: Attributes) -> list[tuple[int, ...]]:
    columns = [values.reshape(len(positions), -1) for _, values in sorted(attributes.items())]
    return sorted(map(tuple, np.column_stack([positions, *columns]).astype(int).tolist()))


class Reference:
    """The authors' network in PyTorch's doubles."""

    def __init__(self, state: dict[str, torch.Tensor]) -> None:
        self.state = {name: value.double() for name, value in state.items()}

    def linear(self, name: str, values: torch.Tensor) -> torch.Tensor:
        weight = self.state[f"{name}.weight"]
        return functional.linear(values, weight.flatten(1), self.state[f"{name}.bias"])

    def pair(self, name: str, values: torch.Tensor) -> torch.Tensor:
        return self.linear(f"{name}.2", self.linear(f"{name}.0", values).relu())

    def outputs(self, offsets: torch.Tensor, values: torch.Tensor, layers: int) -> torch.Tensor:
        features = self.linear("pt.linear_in", values)
        for number in range(layers):
            name = f"pt.sa_ls.{number}"
            embedded = self.linear(f"pt.sa_emb_ls.{number}.0", features).relu()
            summand = self.pair(f"{name}.linear_p_bias", offsets)
            key = self.linear(f"{name}.k_mlp", embedded)
            key = key * self.pair(f"{name}.linear_p_multiplier", offsets) + summand
            value = self.linear(f"{name}.v_mlp", embedded) + summand
            shares = self.pair(f"{name}.weight_encoding", key).softmax(dim=1)
            features = features + self.linear(f"{name}.residual_emb.1", (shares * value).relu())
        pooled = self.linear("mu_sigma_pred.0", features.sum(dim=1)).relu()
        return self.linear("mu_sigma_pred.4", self.linear("mu_sigma_pred.2", pooled).relu())


def test_the_network_is_the_authors(weights: PolopcacWeights) -> None:
    rng = np.random.default_rng(1)
    offsets, values = rng.uniform(-1, 1, (300, 8, 3)), rng.uniform(0, 1, (300, 8, 3))
    reference = Reference(polopcac_state())
    expected = reference.outputs(torch.from_numpy(offsets), torch.from_numpy(values), layers=2)
    with thread_pool(2) as pool:
        result = predicted(weights, np.rint(offsets / STEP), np.rint(values / STEP), pool)
    assert np.abs(result * STEP - expected.numpy()).max() < 1e-3
    assert np.ptp(expected.numpy(), axis=0).min() > 0.1  # it does predict something


def test_sums_of_a_layer_are_exact_and_rounded_once() -> None:
    """Fractions of Python, for weights and inputs as large as they may be."""
    rng = np.random.default_rng(2)
    for weight in (rng.normal(size=(6, 128)), 1e9 * rng.normal(size=(6, 128)), np.zeros((6, 128))):
        bias = rng.normal(size=6) * 900
        inputs = np.rint(rng.uniform(-1024, 1024, (5, 128)) / STEP)
        layer = fixed_linear(weight, bias)
        result = applied(layer, torch.from_numpy(inputs)).numpy()
        for row, output in np.ndindex(5, 6):
            products = zip(inputs[row], layer.matrix[:, output].tolist(), strict=True)
            total = sum(Fraction(a) * Fraction(b) for a, b in products)
            total = (total + Fraction(layer.bias[output].item())) * Fraction(layer.unit)
            limit = Fraction(1024) / Fraction(STEP)
            assert result[row, output] == round(min(max(total, -limit), limit))
    matrix = fixed_linear(rng.normal(size=(6, 128)), bias)
    assert np.abs(matrix.matrix.numpy()).sum(axis=0).max() < 2**25 + 128


@pytest.mark.parametrize("side", [3, 40, 2**20])
def test_the_nearest_points_are_those_of_a_search_in_all(side: int) -> None:
    rng = np.random.default_rng(side)
    points, queries = (rng.integers(0, side, (n, 3)).astype(float) for n in (900, 300))
    with thread_pool(2) as pool:
        found = nearest(queries, points, 8, pool)
    squared = ((queries[:, None] - points[found]) ** 2).sum(axis=2)
    all_squared = ((queries[:, None] - points) ** 2).sum(axis=2)
    assert np.array_equal(squared, np.sort(all_squared, axis=1)[:, :8])
    assert all(len(set(rows)) == 8 for rows in found.tolist())


def test_of_equal_points_the_first_are_the_nearest() -> None:
    points = np.repeat([[5.0, 5, 5], [9, 9, 9]], [50_000, 10], axis=0)
    with thread_pool(1) as pool:
        found = nearest(np.full((40_000, 3), 6.0), points, 8, pool)
    assert (found == np.arange(8)).all()


def test_the_order_is_that_of_splitmix64() -> None:
    """Published outputs of the generator with the seed 0."""
    outputs = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F, 0xF88BB8A8724C81EC]
    assert shuffled(4).tolist() == np.argsort(np.array(outputs, np.uint64)).tolist()
    assert np.array_equal(np.sort(shuffled(10_000)), np.arange(10_000))


def test_groups_double_up_to_a_maximum() -> None:
    sizes = [part.stop - part.start for part in groups(128 * 1000)]
    assert first_group(128 * 1000) == 1000
    assert sizes[:5] == [2000, 4000, 8000, 16000, 16384]
    assert set(sizes[4:-1]) == {16384}
    for points in (1, 7, 8, 9, 127, 128, 2048):
        assert first_group(points) + sum(p.stop - p.start for p in groups(points)) == points
    assert first_group(200) == 8


def test_colours_are_converted_as_published() -> None:
    """YCoCg-R of a red, a green, a blue and a grey point, with 256 added to both differences."""
    rgb = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]], np.int32)
    table = coded(KINDS[-1], rgb)
    assert table.tolist() == [[63, 511, 129], [127, 256, 511], [63, 1, 129], [9, 256, 256]]
    assert np.array_equal(uncoded(KINDS[-1], table), rgb)


@pytest.mark.parametrize("levels", [128, 512])
def test_frequencies_are_those_of_a_laplace_distribution(levels: int) -> None:
    for location, scale in ((40.2, 3.7), (-900.0, 20.0), (levels / 2, 7e5), (77.5, 1.5e-3)):
        found = np.array([cumulative(v, location, scale, levels) for v in range(levels + 1)])
        shares = stats.laplace.cdf(np.arange(levels + 1) - 0.5, location, scale)
        expected = np.rint(shares * (2**16 - levels)) + np.arange(levels + 1)
        assert np.abs(found - expected)[1:-1].max() <= 1
        assert (found[0], found[-1]) == (0, 2**16)
        assert np.diff(found).min() >= 1


def test_outputs_are_locations_and_logarithms_of_scales() -> None:
    outputs = np.array([[0.25, 0, -0.5, 1.5, -2, 40]]) / STEP
    locations, scales = laplace(outputs, 3, 255.0)
    assert locations == pytest.approx([0.75 * 255, 0.5 * 255, 0])
    assert scales == pytest.approx(32 * np.exp([1.5, -2, 10]), rel=1e-12)


def test_values_are_coded_as_the_range_coder_of_tables_codes_them() -> None:
    rng = np.random.default_rng(3)
    locations, scales = rng.uniform(0, 128, 2000), rng.uniform(0.01, 30, 2000)
    values = np.clip(np.rint(rng.laplace(locations, scales)), 0, 127).astype(np.int32)
    table = [
        [cumulative(v, *each, 128) for v in range(129)]
        for each in zip(locations, scales, strict=True)
    ]
    data = encode_values(values, locations, scales, 128)
    assert data == encode_symbols(values.astype(np.uint8), np.array(table, np.int32))
    assert np.array_equal(decode_values(data, locations, scales, 128), values)
    for damaged in (data[:-1], data + b"\0", b""):
        with pytest.raises(InputError, match="its symbols"):
            decode_values(damaged, locations, scales, 128)


@settings(max_examples=60)
@given(data=st.data())
def test_any_attributes_come_back_whatever_the_order(
    weights: PolopcacWeights, data: st.DataObject
) -> None:
    points = data.draw(st.integers(1, 90))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    side, most = (
        data.draw(st.sampled_from([1, 3, 10**6])),
        data.draw(st.sampled_from([1, 127, 255])),
    )
    positions = rng.integers(-side, side, (points, 3))
    attributes: Attributes = {
        "reflectance": rng.integers(0, most + 1, points),
        "colour": rng.integers(0, 256, (points, 3)).astype(np.uint8),
    }
    names = data.draw(st.sampled_from([("reflectance",), ("colour",), ("colour", "reflectance")]))
    attributes = {name: attributes[name] for name in names}
    stream = encode(positions, attributes, weights)
    decoded = decode(stream, positions[::-1], weights)
    assert _rows(positions[::-1], decoded) == _rows(positions, attributes)
    order = rng.permutation(points)
    mixed = {name: values[order] for name, values in attributes.items()}
    assert encode(positions[order], mixed, weights) == stream


def test_a_value_stays_with_its_position(weights: PolopcacWeights) -> None:
    positions = np.argwhere(np.ones((12, 12, 12)))
    values = np.arange(len(positions)) % 251
    decoded = decode(encode(positions, {"reflectance": values}, weights), positions, weights)
    assert np.array_equal(decoded["reflectance"], values)


def test_streams_are_the_same_with_any_number_of_threads(weights: PolopcacWeights) -> None:
    """And on any machine: of these weights, which NumPy makes, the bytes are known."""
    streams = []
    for threads in (1, 3):
        with torch_threads(threads):
            streams.append(encode(*_cloud(), weights))
    assert streams[1] == streams[0]
    runs = [b"".join(each.groups) for each in read_stream(streams[0]).attributes]
    assert [sha256(run).hexdigest()[:16] for run in runs] == KNOWN
    with torch_threads(2):
        positions, attributes = _cloud()
        assert _rows(positions, decode(streams[0], positions, weights)) == _rows(
            positions, attributes
        )


KNOWN = ["1b0c727c526146fa", "f173f1bd7f5cee7a"]


def check_of_the_network() -> int:
    """A number that tells one bit more or less in the network, or in a distribution."""
    path = Path(os.environ["POLOPCAC_WEIGHTS"])
    rng = np.random.default_rng(0)
    offsets, values = np.rint(rng.uniform(-1, 1, (2, 300, 8, 3)) / STEP)
    with thread_pool(1) as pool:
        outputs = predicted(load_weights(path), offsets, values, pool)
    locations, scales = laplace(outputs, 3, 255.0)
    return zlib.crc32(scales, zlib.crc32(locations, zlib.crc32(outputs)))


def test_a_machine_with_other_instructions_computes_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither vectors nor fused multiplications, and a matrix library that does without them."""
    save_tiny("polopcac", tmp_path / "ckpt.pt")
    monkeypatch.setenv("POLOPCAC_WEIGHTS", str(tmp_path / "ckpt.pt"))
    generic = {
        **os.environ, "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "",
        "ATEN_CPU_CAPABILITY": "default", "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
        "MKL_CBWR": "COMPATIBLE",
    }  # fmt: skip
    program = "from tests.pcc_networks.test_polopcac import *; print(check_of_the_network())"
    words = [sys.executable, "-c", program]
    root = Path(__file__).parents[2]
    done = subprocess.run(words, check=True, env=generic, cwd=root, capture_output=True)
    assert int(done.stdout) == check_of_the_network()


def test_what_the_network_does_not_know_is_stored(
    weights: PolopcacWeights, monkeypatch: pytest.MonkeyPatch
) -> None:
    positions, attributes = _cloud(300)
    large = {"reflectance": attributes["reflectance"].astype(int) * 257}
    stream = encode(positions, large, weights)
    (part,) = read_stream(stream).attributes
    assert part.stored is not None
    assert _rows(positions, decode(stream, positions, weights)) == _rows(positions, large)
    # and what a decoder would refuse: attributes with few bytes for their points
    monkeypatch.setattr(stream_module, "_POINTS", 0)
    monkeypatch.setattr(stream_module, "_POINTS_PER_BYTE", 0)
    stream = encode(positions, attributes, weights)
    assert all(each.stored is not None for each in read_stream(stream).attributes)
    assert _rows(positions, decode(stream, positions, weights)) == _rows(positions, attributes)


def test_bytes_are_told_apart(weights: PolopcacWeights) -> None:
    positions, attributes = _cloud()
    both = attribute_bytes(encode(positions, attributes, weights))
    stream = encode(positions, attributes, weights)
    assert both.keys() == attributes.keys()
    assert sum(both.values()) == len(stream)
    # alone, a point is predicted from as many; the order of equal points may differ
    alone = len(encode(positions, {"colour": attributes["colour"]}, weights))
    assert both["colour"] == pytest.approx(alone, rel=0.02)


def test_what_cannot_be_coded_is_refused(weights: PolopcacWeights) -> None:
    positions, attributes = _cloud(20)
    grey = attributes["reflectance"].astype(float)
    for held, fault in (
        ({}, "no attributes"),
        ({"normals": grey}, "normals is neither reflectance nor colour"),
        ({"reflectance": grey + 0.5}, "whole numbers to 65535"),
        ({"reflectance": grey - 200}, "whole numbers to 65535"),
        ({"reflectance": grey * np.nan}, "whole numbers to 65535"),
        ({"reflectance": grey.astype(str)}, "whole numbers to 65535"),
        ({"reflectance": grey[1:]}, r"shape \(20,\)"),
        ({"colour": attributes["colour"] * 2.0 + 200}, "whole numbers to 255"),
        ({"colour": grey}, r"shape \(20, 3\)"),
    ):
        with pytest.raises(InputError, match=fault):
            encode(positions, held, weights)
    with pytest.raises(InputError, match="at least 1"):
        encode(positions[:0], {"reflectance": grey[:0]}, weights)
    positions[0, 1] = 2**25
    with pytest.raises(InputError, match="beyond 2\\^24"):
        encode(positions, attributes, weights)


def test_each_damage_ends_in_one_error(weights: PolopcacWeights) -> None:
    positions, attributes = _cloud(400)
    stream, rng = encode(positions, attributes, weights), np.random.default_rng(5)
    for trial in range(150):
        damaged = bytearray(stream if trial % 3 else stream[: rng.integers(len(stream))])
        for _ in range(rng.integers(1, 4)):
            if damaged:
                damaged[rng.integers(len(damaged))] ^= rng.integers(1, 256)
        with suppress(InputError):  # bits after the last of a group have no effect
            decoded = decode(bytes(damaged), positions, weights)
            assert _rows(positions, decoded) == _rows(positions, attributes)
    content = read_stream(stream)
    grey, colour = content.attributes
    stored = replace(grey, stored=b"", groups=(), first=b"")
    for changed, fault in (
        (replace(content, check=content.check ^ 1), "decodes to other attributes"),
        (replace(content, attributes=(grey, grey)), "its attributes"),
        (replace(content, attributes=()), "its attributes"),
        (replace(content, digest=bytes(8)), "made with other weights"),
        (replace(content, attributes=(stored,)), "Zstandard"),
        (replace(content, attributes=(replace(grey, groups=(b"",) * 5),)), "its symbols"),
        (replace(content, attributes=(replace(colour, groups=(bytes(90),) * 5),)), "its symbols"),
    ):
        with pytest.raises(InputError, match=fault):
            decode(write_stream(changed), positions, weights)
    with pytest.raises(InputError, match="its attributes"):
        decode(stream + b"!", positions, weights)
    with pytest.raises(InputError, match="of 400 points, not of 399"):
        decode(stream, positions[1:], weights)
    with pytest.raises(InputError, match=r"its symbols|positions are others"):
        decode(stream, positions**3, weights)


def test_points_cannot_be_promised_without_bytes(weights: PolopcacWeights) -> None:
    content = read_stream(encode(*_cloud(400), weights))
    grey = content.attributes[0]
    for points in (2**14 + 1, 2**24, 2**34):
        runs = CodedAttribute(grey.kind, None, bytes(first_group(points)), (b"",) * 20)
        promise = replace(content, points=points, attributes=(runs,))
        with pytest.raises(InputError, match=r"too many points|truncated"):
            read_stream(write_stream(promise))
    assert stream_module.is_decodable(replace(grey, groups=(bytes(1000),)), 2**14 + 8000)
    assert not stream_module.is_decodable(replace(grey, groups=(bytes(1000),)), 2**14 + 8001)


def test_foreign_weights_are_named(tmp_path: Path) -> None:
    state = polopcac_state()
    name = "mu_sigma_pred.4.bias"
    faults: dict[str, Any] = {
        "less": {key: value for key, value in state.items() if key != name},
        "shape": state | {name: torch.zeros(7)},
        "infinite": state | {name: torch.full((6,), torch.inf)},
        "wide": {"pt.linear_in.weight": torch.zeros(257, 3, 1, 1)},
        "no_layers": {"pt.linear_in.weight": torch.zeros(8, 3, 1, 1)},
        "other": {"pt.linear_in.weight": 3},
    }
    for file, value in faults.items():
        torch.save(value, tmp_path / f"{file}.pt")
    (tmp_path / "text.pt").write_text("text")
    for file in (*faults, "text"):
        with pytest.raises(
            InputError, match=rf"{file}\.pt: not a checkpoint of PoLoPCAC"
        ) as raised:
            load_weights(tmp_path / f"{file}.pt")
        assert "\n" not in str(raised.value)

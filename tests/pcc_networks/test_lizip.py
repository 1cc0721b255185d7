"""LiZIP with random weights: the authors' bytes, the network's sums, and damaged streams."""

import lzma
import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from pcc_networks.lizip import codec as coder_module
from pcc_networks.lizip.codec import decode, encode
from pcc_networks.lizip.compression import Compression, compressed, decompressed
from pcc_networks.lizip.inference import linear, steps_of
from pcc_networks.lizip.stream import (
    LizipStream,
    authors_file,
    check_work,
    read_stream,
    write_stream,
)
from pcc_networks.lizip.weights import LizipWeights, load_weights
from pointkit.errors import InputError
from tests.support.learned_codecs import endure_damage, lizip_file, sealed, torch_threads

STEP = 0.00001
pytestmark = pytest.mark.usefixtures("one_thread")


def scan(points: int = 700, seed: int = 0) -> np.ndarray:
    """Points (n, 3), m, of single precision about a sensor."""
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(points, 3)) * [30, 20, 2]).astype(np.float32).astype(np.float64)


def _weights(folder: Path, sizes: Sequence[int] = (9, 20, 40, 3), seed: int = 0) -> LizipWeights:
    path = folder / f"mlp_{'_'.join(map(str, sizes))}_{seed}.bin"
    path.write_bytes(lizip_file(sizes, seed))
    return load_weights(path)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> LizipWeights:
    return _weights(tmp_path_factory.mktemp("lizip"))


THEIRS = {
    ((9, 20, 40, 3), 700, "lzma"): "0c5bf475ef2cbac4",
    ((9, 256, 256, 256, 3), 900, "lzma"): "f6670a454918396e",
    ((15, 20, 3), 131, "lzma"): "a26cf04e19415897",
    ((9, 20, 40, 3), 4, "lzma"): "e9f856b082234900",
    ((9, 20, 40, 3), 700, "zlib"): "fb9123e80fbc08e5",
}
"""The first digits of the SHA-256 of files that the authors' program wrote (commit 4dfd26d, GCC
12.2 with -O2 -fopenmp -mavx2 -mfma, liblzma 5.4.1, zlib 1.2.13) of `scan` with weights of
`lizip_file`: by sizes of the layers, number of points and compressor."""


@pytest.mark.parametrize(("sizes", "points", "compression"), THEIRS)
def test_files_are_those_of_the_authors_program(
    sizes: Sequence[int], points: int, compression: Compression, tmp_path: Path
) -> None:
    stream = encode(scan(points), _weights(tmp_path, sizes), STEP, compression)
    file = authors_file(read_stream(stream))
    assert sha256(file).hexdigest()[:16] == THEIRS[tuple(sizes), points, compression]


DECODED = "840db7a91af44415"
"""The same of the points, float32, that the authors' program decodes from the first file."""


def test_decoded_points_are_those_of_the_authors_program(weights: LizipWeights) -> None:
    points = decode(encode(scan(), weights, STEP), weights)
    assert sha256(points.astype("<f4").tobytes()).hexdigest()[:16] == DECODED


def _fused(a: Fraction, b: Fraction, total: np.float32) -> np.float32:
    """a * b + total, rounded once to single precision."""
    exact = a * b + Fraction(float(total))
    near = np.float32(float(exact))
    around = [near, np.nextafter(near, np.float32(np.inf)), np.nextafter(near, -np.float32(np.inf))]
    return min(around, key=lambda one: (abs(Fraction(float(one)) - exact), one.view("u4") & 1))


@pytest.mark.parametrize("inputs", [9, 15, 20])
def test_a_sum_has_eight_lanes_and_a_rest(inputs: int, tmp_path: Path) -> None:
    """Exact fractions rounded once a step: what IEEE 754 asks of every machine."""
    path = tmp_path / "a.bin"
    path.write_bytes(lizip_file((9, inputs, 3), seed=3))
    layer = load_weights(path).layers[1]
    data = np.frombuffer(path.read_bytes(), "<f4")  # after two layers' sizes and the first layer
    matrix = data[-3 * inputs - 3 : -3].reshape(3, inputs)
    values = np.random.default_rng(1).normal(size=inputs).astype(np.float32)
    made = np.empty(3, np.float32)
    linear(inputs)(values, 1, 3, layer.lanes, layer.rest, layer.bias, True, made)
    for row, bias, found in zip(matrix, data[-3:], made, strict=True):
        products = [
            (Fraction(float(a)), Fraction(float(b))) for a, b in zip(values, row, strict=True)
        ]
        whole, lanes = inputs // 8 * 8, [np.float32(0)] * 8
        for k in range(whole):
            lanes[k % 8] = _fused(*products[k], lanes[k % 8])
        halves = [lanes[k] + lanes[k + 4] for k in range(4)]
        total = (halves[0] + halves[2]) + (halves[1] + halves[3])
        for k in range(whole, inputs):
            total = _fused(*products[k], total)
        assert found == bias + total


def test_steps_are_rounded_away_from_zero_and_have_32_bits() -> None:
    values = np.array([0.4, 0.5, -0.5, 2.5, -1.49, 2**31, -(2**31) - 300, np.nan, np.inf])
    steps = steps_of(values.astype(np.float32), np.float32(1))
    least = -(2**31)
    assert steps.tolist() == [0, 1, -1, 3, -1, least, least, least, least]


@pytest.mark.parametrize("points", [1, 4, 5, 6, 127, 128, 129, 133, 134, 700])
@pytest.mark.parametrize("step_m", [STEP, 0.01])
def test_every_point_comes_back_within_half_a_step(
    weights: LizipWeights, points: int, step_m: float
) -> None:
    cloud = scan(points)
    decoded = decode(encode(cloud, weights, step_m, "zlib"), weights)
    spacing = np.spacing(np.float32(np.abs(cloud).max()))
    assert decoded.shape == cloud.shape
    difference = np.sort(decoded, axis=0) - np.sort(cloud, axis=0)
    assert np.abs(difference).max() <= step_m / 2 + spacing
    assert np.abs(decoded / step_m - np.rint(decoded / step_m)).max() <= spacing / step_m


def test_points_are_in_morton_order_of_cubes(weights: LizipWeights) -> None:
    cubes = np.random.default_rng(5).integers(0, 200, (900, 3))
    cloud = np.concatenate([[[0.0, 0, 0]], 0.1 * cubes + 0.05])
    decoded = decode(encode(cloud, weights, STEP), weights)
    assert not decoded[0].any()
    order = [_morton_code(cube) for cube in np.floor(decoded / 0.1).astype(int)]
    assert order == sorted(order)
    assert len(set(order)) > 800


def _morton_code(cube: np.ndarray) -> int:
    x, y, z = (f"{number:08b}" for number in cube)
    return int("".join(a + b + c for a, b, c in zip(z, y, x, strict=True)), 2)


def test_streams_are_the_same_with_any_number_of_threads(weights: LizipWeights) -> None:
    streams, cloud = [], scan(2000)
    for threads in (1, 3):
        with torch_threads(threads):
            streams.append(encode(cloud, weights, STEP))
    assert streams[0] == streams[1]


@pytest.mark.parametrize("size", [1, 100, 40_000])
def test_compressors_restore_the_numbers(size: int) -> None:
    numbers = np.random.default_rng(0).integers(0, 5, size, np.uint8).tobytes()
    for number, name in ((1, "zlib"), (2, "lzma")):
        data = compressed(numbers, name)  # type: ignore[arg-type]
        assert decompressed(data, number, size) == numbers
    assert lzma.decompress(data) == numbers
    assert decompressed(numbers, 0, size) == numbers


def test_what_expands_beyond_its_size_is_refused() -> None:
    bombs = {1: zlib.compress(bytes(10**6)), 2: lzma.compress(bytes(10**6)), 0: bytes(200)}
    for number, bomb in bombs.items():
        for data in (bomb, bomb[:-1], bomb + b"!", b""):
            with pytest.raises(InputError, match="damaged"):
                decompressed(data, number, 100)
    with pytest.raises(InputError, match="compressor 3"):
        decompressed(bytes(100), 3, 100)
    large = {"id": lzma.FILTER_LZMA2, "dict_size": 2**28}
    with pytest.raises(InputError, match="its LZMA data"):
        decompressed(lzma.compress(bytes(100), filters=[large]), 2, 100)


def test_each_damage_ends_in_one_error(weights: LizipWeights) -> None:
    stream = encode(scan(300), weights, STEP)
    endure_damage(lambda damaged: decode(damaged, weights), stream, 5, seed=1)
    coded = read_stream(stream)
    assert write_stream(coded) == stream
    for changed, fault in (
        (replace(coded, check=coded.check ^ 1), "this machine does not compute"),
        (replace(coded, scale=50_000.0), "this machine does not compute"),
        (replace(coded, scale=float("nan")), "its header"),
        (replace(coded, points=301), "this machine does not compute"),
        (replace(coded, points=500), "the size of its numbers"),
        (replace(coded, packed=coded.packed[:-1]), "damaged"),
        (replace(coded, compressor=3), "compressor 3"),
        (replace(coded, digest=bytes(8)), "made with other weights"),
    ):
        with pytest.raises(InputError, match=fault):
            decode(write_stream(changed), weights)
    for place, value in ((21, b"X"), (26, b"\3"), (28, b"\1"), (33, b"\7"), (41, b"\2")):
        changed_bytes = sealed(stream[:place] + value + stream[place + 1 :], 5)
        with pytest.raises(InputError, match="its header"):
            decode(changed_bytes, weights)
    with pytest.raises(InputError, match="truncated"):
        decode(sealed(stream[:40], 5), weights)


def test_a_stream_cannot_promise_points_without_bytes() -> None:
    """Each costs the decoder a run of the network."""
    coded = LizipStream(bytes(8), 0, 2**17, 1e5, 2, b"")
    check_work(coded)
    check_work(replace(coded, points=2**17 + 80, packed=bytes(10)))
    for points, packed in ((0, b""), (2**17 + 1, b""), (2**24 + 1, bytes(2**22))):
        with pytest.raises(InputError, match="too many for a stream of this size"):
            check_work(replace(coded, points=points, packed=packed))


def test_what_a_decoder_would_refuse_is_not_encoded(
    weights: LizipWeights, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="more than 32 bits per coordinate"):
        encode(np.array([[0.0, 0, 0], [21_475, 0, 0]]), weights, STEP)
    for step in (1e4, 1e-8):
        with pytest.raises(InputError, match="step_m is"):
            encode(scan(11), weights, step)
    monkeypatch.setattr(coder_module, "MAX_POINTS", 10)
    with pytest.raises(InputError, match="11 points, more than 10"):
        encode(scan(11), weights, STEP)


def test_a_machine_that_computes_otherwise_says_so(
    weights: LizipWeights, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = encode(scan(300), weights, STEP)
    real = coder_module.predicted
    monkeypatch.setattr(coder_module, "predicted", lambda *words: real(*words) + np.int32(1))
    with pytest.raises(InputError, match="this machine does not compute as the encoder's did"):
        decode(stream, weights)


def test_foreign_weights_are_named(tmp_path: Path) -> None:
    whole, bias = lizip_file(), struct.pack("<f", np.inf)
    turned = whole.replace(struct.pack("<II", 20, 40), struct.pack("<II", 40, 20))
    faults = {
        "text": (b"text", "not weights of LiZIP"),
        "cut": (whole[:-1], "truncated"),
        "long": (whole + b"!", "its length"),
        "infinite": (whole[:-4] + bias, "not finite"),
        "none": (b"LIZM\0\0\0\0", "sizes of its layers"),
        "turned": (turned, "sizes of its layers|truncated"),
        "four": (lizip_file((9, 20, 4)), "sizes of its layers"),
        "ten": (lizip_file((10, 20, 3)), "10 inputs; up to 5 points"),
        "eight": (lizip_file((24, 20, 3)), "24 inputs; up to 5 points"),
        "wide": (lizip_file((9, 4097, 3)), "sizes of its layers"),
        "deep": (lizip_file((9, *[3] * 17)), "sizes of its layers"),
    }
    for name, (data, fault) in faults.items():
        path = tmp_path / f"{name}.bin"
        path.write_bytes(data)
        with pytest.raises(InputError, match=fault) as raised:
            load_weights(path)
        assert str(raised.value).startswith(str(path))
        assert "\n" not in str(raised.value)

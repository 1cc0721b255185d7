"""RAHT against stored results of TMC13 v14.0, and against its properties."""

import hashlib

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpcc.attributes import raht
from gpcc.attributes.quantisation import Qps
from pointkit.geometry.morton import morton_codes


def _cloud() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points with duplicates, sorted, their codes, and three smooth values of each."""
    points = np.random.default_rng(0).integers(0, (40, 24, 12), (1500, 3))
    points[0] = 0
    codes = morton_codes(points, np.arange(3))
    x, y, z = points[np.argsort(codes)].T
    values = np.stack([7 * x + y * z, x * y + 50, 180 - 4 * y + 3 * z], axis=1) % 256
    return np.stack([x, y, z], axis=1), np.sort(codes), values.astype(np.int32)


def _qps(layers: list[list[int]], most: int = 51, region: np.ndarray | None = None) -> Qps:
    inside = np.zeros(0, dtype=bool) if region is None else region
    return Qps(np.array(layers), np.array([[0, 0], [-7, 0]]), inside.astype(np.uint8), most, 0)


def _digest(coded: raht.Coded) -> str:
    numbers = coded.coefficients.tobytes() + coded.reconstruction.tobytes()
    return hashlib.sha256(numbers).hexdigest()[:32]


def test_coefficients_and_reconstruction_are_those_of_tmc13() -> None:
    points, codes, values = _cloud()
    coded = raht.forward(codes, values[:, :1], _qps([[34, 0]]), (2, 6))
    assert _digest(coded) == "12cbab9438955cdb7241dca3c68b60ba"

    layers = _qps([[22, 4], [31, -1], [38, 6]])
    coded = raht.forward(codes, np.ascontiguousarray(values[:, [1, 2, 0]]), layers, (0, 3))
    assert _digest(coded) == "7238fe5fd6b0d61a91ba5cb6f56cb973"

    region = ((points >= [8, 4, 0]) & (points <= [23, 13, 5])).all(axis=1)
    coded = raht.forward(codes, 16 * values[:, :1], _qps([[16, 0]], 75, region), None)
    assert _digest(coded) == "90bd4be3f4d8c1cbe563517787fbd11d"


@settings(deadline=None, max_examples=40)
@given(
    st.integers(1, 200),
    st.integers(1, 21),
    st.sampled_from([1, 3]),
    st.integers(4, 51),
    st.sampled_from([None, (0, 0), (2, 6)]),
)
def test_decoder_reconstructs_as_the_encoder(
    count: int, bits: int, components: int, qp: int, thresholds: raht.Thresholds
) -> None:
    random = np.random.default_rng(count)
    codes = np.sort(morton_codes(random.integers(0, 1 << bits, (count, 3)), np.arange(3)))
    values = random.integers(0, 256, (count, components)).astype(np.int32)
    coded = raht.forward(codes, values, _qps([[qp, 0]]), thresholds)
    decoded = raht.inverse(codes, coded.coefficients, _qps([[qp, 0]]), thresholds)
    assert np.array_equal(decoded, coded.reconstruction)
    if qp == 4:
        assert len(np.unique(codes)) == 1 or np.abs(decoded - values).max() <= 2


def test_coefficients_of_a_cube_are_sums_and_differences_along_its_axes() -> None:
    values = np.random.default_rng(2).integers(0, 256, (8, 3)).astype(np.int32)
    haar = np.array([[1, 1], [-1, 1]])
    expected = np.kron(np.kron(haar, haar), haar) @ values / np.sqrt(8)
    coded = raht.forward(np.arange(8), values, _qps([[4, 0]]), None)
    assert np.abs(coded.coefficients - expected[[0, 4, 2, 1, 6, 5, 3, 7]]).max() < 0.51


def test_damaged_coefficients_end_in_values() -> None:
    _, codes, _ = _cloud()
    random = np.random.default_rng(1)
    coefficients = random.integers(-(1 << 31), 1 << 31, (len(codes), 3)).astype(np.int32)
    values = raht.inverse(codes, coefficients, _qps([[51, 0]]), (2, 6))
    assert values.shape == (len(codes), 3)


def test_no_points_have_no_coefficients() -> None:
    none = np.zeros((0, 1), dtype=np.int32)
    coded = raht.forward(np.zeros(0, dtype=np.int64), none, _qps([[4, 0]]), None)
    assert coded.coefficients.shape == coded.reconstruction.shape == (0, 1)

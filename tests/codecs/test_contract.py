"""The contract of codecs of points, over all of the registry that can run here."""

import subprocess
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from puckbench.codecs.base import Codec
from puckbench.codecs.external.program import ExternalCodec
from puckbench.codecs.learned.codec import LearnedByLambda
from puckbench.codecs.registry import codec_of, codecs, open_codec
from puckbench.core.errors import InputError

POINTS = [name for name, found in codecs().items() if found.takes == "points" and found.rates]
NAMES = [name for name in POINTS if open_codec(name).available().ok]
OWN = [name for name in NAMES if not isinstance(open_codec(name), ExternalCodec)]
# A network draws surfaces like those that it has seen, and promises no distance of any other.
FAITHFUL = [name for name in NAMES if not isinstance(open_codec(name), LearnedByLambda)]


@pytest.fixture(params=NAMES, scope="module")
def codec(request: pytest.FixtureRequest) -> Codec:
    codec = open_codec(request.param)
    codec.load()
    return codec


def _surface(points: int = 4000) -> np.ndarray:
    """A sphere and a plane, as clouds of the benchmark are: surfaces within [0, 1023]."""
    rng = np.random.default_rng(5)
    ball = rng.normal(size=(points // 2, 3))
    ball = 500 + 400 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    plane = np.column_stack([rng.random((points // 2, 2)) * 1023, np.full(points // 2, 100.0)])
    return np.vstack([ball, plane])


def _dense() -> np.ndarray:
    """A ball of neighbouring voxels, which a network can code."""
    points = np.random.default_rng(5).normal(size=(6000, 3))
    points *= 20 / np.linalg.norm(points, axis=1, keepdims=True)
    return np.unique(np.rint(32 + points), axis=0)


def _cloud(codec: Codec) -> np.ndarray:
    return _surface() if codec.name in FAITHFUL else _dense()


def _farthest(a: np.ndarray, b: np.ndarray) -> float:
    from scipy.spatial import cKDTree

    return float(max(cKDTree(b).query(a)[0].max(), cKDTree(a).query(b)[0].max()))


def _tolerance(codec: Codec, points: np.ndarray, least_extent: float) -> float:
    """A hundredth of the extent, or the diagonal of a cell of the codec's fixed grid."""
    extent = max(float(np.ptp(points, axis=0).max()), least_extent)
    return max(extent / 100, codec.grid * 3**0.5)


def _sorted(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


@pytest.mark.parametrize("codec", FAITHFUL, indirect=True)
def test_bytes_and_error_are_monotone_in_rate(codec: Codec) -> None:
    points = _surface()
    streams = [codec.encode(points, rate) for rate in codec.rates]
    sizes = [len(stream) for stream in streams]
    errors = [_farthest(points, codec.decode(stream)) for stream in streams]
    assert sizes == sorted(sizes)
    assert errors[-1] < errors[0] / 4


def test_the_same_input_gives_the_same_bytes(codec: Codec) -> None:
    points = _cloud(codec)
    for rate in codec.rates:
        assert codec.encode(points, rate) == codec.encode(points.copy(), rate)


def test_the_order_of_the_points_does_not_change_the_decoded_set(codec: Codec) -> None:
    points = _cloud(codec)
    shuffled = np.random.default_rng(0).permutation(points)
    rate = list(codec.rates)[len(codec.rates) // 2]
    decoded = [codec.decode(codec.encode(cloud, rate)) for cloud in (points, shuffled)]
    assert np.array_equal(_sorted(decoded[0]), _sorted(decoded[1]))


def test_streams_decode_in_a_fresh_process(codec: Codec, tmp_path: Path) -> None:
    rate = next(iter(codec.rates))
    stream = codec.encode(_cloud(codec), rate)
    (tmp_path / "a.bin").write_bytes(stream)
    program = (
        "import sys, numpy as np; from puckbench.codecs.registry import open_codec;"
        "c = open_codec(sys.argv[1]); c.load();"
        "np.save(sys.argv[3], c.decode(open(sys.argv[2], 'rb').read()))"
    )
    command = [sys.executable, "-c", program, codec.name]
    subprocess.run([*command, tmp_path / "a.bin", tmp_path / "a.npy"], check=True)
    assert np.array_equal(np.load(tmp_path / "a.npy"), codec.decode(stream))


def test_the_stream_names_a_codec_that_decodes_it(codec: Codec) -> None:
    stream = codec.encode(_cloud(codec), next(iter(codec.rates)))
    named = open_codec(codec_of(stream))
    assert np.array_equal(_sorted(named.decode(stream)), _sorted(codec.decode(stream)))


def test_the_input_is_not_changed(codec: Codec) -> None:
    points = _cloud(codec)
    before = points.copy()
    codec.encode(points, next(iter(codec.rates)))
    assert np.array_equal(points, before)


@pytest.mark.parametrize(
    ("points", "fault"),
    [(np.empty((0, 3)), "empty"), (np.full((3, 3), np.nan), "not finite")],
    ids=["empty", "nan"],
)
def test_unusable_clouds_are_refused(codec: Codec, points: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        codec.encode(points, next(iter(codec.rates)))


def test_unknown_rates_are_refused(codec: Codec) -> None:
    with pytest.raises(InputError, match="unknown rate 'r99'"):
        codec.encode(_surface(10), "r99")


SPECIAL = {
    "one point": np.array([[3.0, 2.0, 1.0]]),
    "duplicates": np.repeat([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 20, axis=0),
    "collinear": np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)]),
    "negative": -np.arange(60.0).reshape(20, 3),
    "huge": 1e6 + np.arange(60.0).reshape(20, 3) * 1e3,
}


@pytest.mark.parametrize("name", SPECIAL)
def test_special_clouds_come_back(codec: Codec, name: str) -> None:
    points = SPECIAL[name]
    best = list(codec.rates)[-1]
    decoded = codec.decode(codec.encode(points, best))
    assert decoded.shape[1] == 3
    assert np.isfinite(decoded).all()
    if codec.name in FAITHFUL:
        assert _farthest(points, decoded) <= _tolerance(codec, points, 1.0)


@pytest.mark.parametrize("codec", FAITHFUL, indirect=True)
@settings(max_examples=40)
@given(
    points=arrays(
        np.float64,
        st.tuples(st.integers(1, 60), st.just(3)),
        elements=st.floats(-1e4, 1e4, allow_nan=False, width=32),
    )
)
def test_every_point_comes_back_within_the_finest_rate(codec: Codec, points: np.ndarray) -> None:
    decoded = codec.decode(codec.encode(points, list(codec.rates)[-1]))
    assert _farthest(points, decoded) <= _tolerance(codec, points, 1e-2)
    assert len(decoded) <= len(points)


FAR = np.array([500_000.0, 5_000_001.0, -3_000_000.0])


def test_a_cloud_far_away_decodes_to_the_shifted_decode_of_the_near_one(codec: Codec) -> None:
    near = np.rint(_cloud(codec))
    near -= near.min(axis=0)
    for rate in codec.rates:
        decoded = [codec.decode(codec.encode(cloud, rate)) for cloud in (near, near + FAR)]
        assert np.array_equal(_sorted(decoded[0] + FAR), _sorted(decoded[1]))


def test_a_cloud_at_the_origin_is_coded_as_it_is(codec: Codec) -> None:
    points = _cloud(codec)
    rate = next(iter(codec.rates))
    assert codec.encode(points, rate) == codec._encode(points, codec.rates[rate])


@cache
def _stream(codec: Codec) -> bytes:
    return codec.encode(_surface(300), next(iter(codec.rates)))


# Programs of others may crash and hang on damage, under limits: see test_external.
@pytest.mark.parametrize("codec", OWN, indirect=True)
@settings(max_examples=300)
@given(data=st.data())
def test_damaged_streams_end_in_one_clean_error_or_points(
    codec: Codec, data: st.DataObject
) -> None:
    stream = bytearray(_stream(codec))
    cut = data.draw(st.integers(0, len(stream)))
    damaged = stream[:cut] if data.draw(st.booleans()) else stream
    for _ in range(data.draw(st.integers(1, 4))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    with suppress(InputError):
        decoded = codec.decode(bytes(damaged))
        assert decoded.ndim == 2
        assert np.isfinite(decoded).all()

"""The contract of codecs of points, over all of the registry that can run here.

A codec with rates of clouds in metres runs a second time, on clouds of a room's size at these.
"""

import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import Codec, Parameters
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.learned import LearnedByLambda
from puckbench.codecs.rates import metric_rates, scaled_rates
from puckbench.codecs.registry import codec_of, codecs, open_codec
from puckbench.codecs.reno import PUBLISHED_WEIGHTS
from puckbench.codecs.returns_codec import ReturnsCodec
from tests.support.codecs import decode, encode

UNITS_PER_METRE = 128.0
"""Of scaled clouds that are taken for ones in metres: rooms of 8 m."""
METRES = " (metres)"


@dataclass(frozen=True)
class Case:
    """A codec, and the clouds and rates that it is tested with."""

    codec: Codec
    is_metric: bool

    @property
    def rates(self) -> Mapping[str, Parameters]:
        table = self.codec.rates
        return metric_rates(table) if self.is_metric else scaled_rates(table)

    @property
    def grid(self) -> float:
        """Spacing of the finest rate's grid, 0 for a codec that adapts to the cloud."""
        if self.is_metric:
            return min(float(rate.removesuffix("mm")) / 1000 for rate in self.rates)
        return getattr(self.codec, "grid", 0.0)

    def encode(self, points: np.ndarray, rate: str) -> bytes:
        return encode(self.codec, points, rate)

    def decode(self, stream: bytes) -> np.ndarray:
        return decode(self.codec, stream)

    def of_size(self, points: np.ndarray) -> np.ndarray:
        """Points in the units of the clouds of this case."""
        return points / UNITS_PER_METRE if self.is_metric else points

    def surface(self, points: int = 4000) -> np.ndarray:
        return self.of_size(_surface(points))

    def cloud(self) -> np.ndarray:
        return self.of_size(_dense() if _estimates(self.codec) else _surface())


def _cases() -> list[str]:
    """Names of codecs; those of clouds in metres with a word that says so."""
    opened = {name: open_codec(name) for name in codecs()}
    classes = {name: codec for name, codec in opened.items() if not isinstance(codec, ReturnsCodec)}
    here = [name for name in classes if not why_not_here(classes[name])]
    scaled = [name for name in here if scaled_rates(classes[name].rates)]
    if find_spec("torch") and "reno" not in here:
        here.append("reno")  # with the random weights of `at_work`
    return scaled + [name + METRES for name in here if metric_rates(classes[name].rates)]


@cache
def _opened(case: str) -> Case:
    return Case(open_codec(case.removesuffix(METRES)), case.endswith(METRES))


def _estimates(codec: Codec) -> bool:
    """Whether the codec decodes an estimate of the surface, and promises no distance of any other:
    a network draws surfaces like those it has seen, denoising rounds edges off."""
    return isinstance(codec, LearnedByLambda) or getattr(codec, "estimates", False)


NAMES = _cases()
FAITHFUL = [name for name in NAMES if not _estimates(_opened(name).codec)]
# Streams of clouds in metres have decoders of their own where there are no others.
OWN = [
    name
    for name in NAMES
    if not isinstance(_opened(name).codec, ExternalCodec)
    and name.removesuffix(METRES) not in set(NAMES) - {name}
]


@pytest.fixture(autouse=True, scope="module")
def at_work(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The working directory, with random weights of RENO where the codec looks for its authors'."""
    folder = tmp_path_factory.mktemp("contract")
    if find_spec("torch"):
        from tests.support.learned_codecs import save_tiny

        save_tiny("reno", folder / PUBLISHED_WEIGHTS / "KITTIDetection.pt")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(params=NAMES, scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    case = _opened(request.param)
    case.codec.load()
    return case


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


def _farthest(a: np.ndarray, b: np.ndarray) -> float:
    from scipy.spatial import cKDTree

    return float(max(cKDTree(b).query(a)[0].max(), cKDTree(a).query(b)[0].max()))


def _tolerance(case: Case, points: np.ndarray, least_extent: float) -> float:
    """A hundredth of the extent, or the diagonal of a cell of the codec's fixed grid."""
    extent = max(float(np.ptp(points, axis=0).max()), least_extent)
    return max(extent / 100, case.grid * 3**0.5)


def _sorted(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


@cache
def _streams(case: Case) -> dict[str, bytes]:
    """Streams of the case's cloud by rate: coded once for all tests."""
    work = case.codec.prepare(PointCloud(case.cloud()))
    return {rate: encode(case.codec, case.cloud(), rate, work) for rate in case.rates}


@pytest.mark.parametrize("case", FAITHFUL, indirect=True)
def test_bytes_and_error_are_monotone_in_rate(case: Case) -> None:
    points, streams = case.cloud(), _streams(case).values()
    sizes = [len(stream) for stream in streams]
    errors = [_farthest(points, case.decode(stream)) for stream in streams]
    assert sizes == sorted(sizes)
    assert errors[-1] < errors[0] / 4


def test_the_same_input_gives_the_same_bytes(case: Case) -> None:
    for rate, stream in _streams(case).items():
        assert case.encode(case.cloud(), rate) == stream


def test_the_order_of_the_points_does_not_change_the_decoded_set(case: Case) -> None:
    shuffled = np.random.default_rng(0).permutation(case.cloud())
    rate = list(case.rates)[len(case.rates) // 2]
    streams = (_streams(case)[rate], case.encode(shuffled, rate))
    decoded = [case.decode(stream) for stream in streams]
    assert np.array_equal(_sorted(decoded[0]), _sorted(decoded[1]))


@pytest.fixture(scope="module")
def decoded_elsewhere(at_work: Path) -> list[np.ndarray]:
    """The points that a fresh process decodes of a stream of each case."""
    for number, name in enumerate(NAMES):
        case = _opened(name)
        case.codec.load()
        (at_work / f"{number}.bin").write_bytes(next(iter(_streams(case).values())))
    program = (
        "import sys, numpy as np; from puckbench.codecs.registry import open_codec\n"
        "from puckbench.codecs.coding import decoded\n"
        "for number, name in enumerate(sys.argv[1:]):\n"
        "    codec = open_codec(name); codec.load()\n"
        "    np.save(f'{number}.npy', decoded(codec, open(f'{number}.bin', 'rb').read()).xyz)"
    )
    names = [name.removesuffix(METRES) for name in NAMES]
    subprocess.run([sys.executable, "-c", program, *names], cwd=at_work, check=True)
    return [np.load(at_work / f"{number}.npy") for number in range(len(NAMES))]


def test_streams_decode_in_a_fresh_process(case: Case, decoded_elsewhere: list[np.ndarray]) -> None:
    number = NAMES.index(case.codec.name + METRES * case.is_metric)
    decoded = case.decode(next(iter(_streams(case).values())))
    assert np.array_equal(decoded_elsewhere[number], decoded)


def test_the_stream_names_a_codec_that_decodes_it(case: Case) -> None:
    stream = next(iter(_streams(case).values()))
    named = open_codec(codec_of(stream))
    assert np.array_equal(_sorted(decode(named, stream)), _sorted(case.decode(stream)))


def test_the_input_is_not_changed(case: Case) -> None:
    points = case.cloud()
    before = points.copy()
    case.encode(points, next(iter(case.rates)))
    assert np.array_equal(points, before)


@pytest.mark.parametrize(
    ("points", "fault"),
    [(np.empty((0, 3)), "empty"), (np.full((3, 3), np.nan), "not finite")],
    ids=["empty", "nan"],
)
def test_unusable_clouds_are_refused(case: Case, points: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        case.encode(points, next(iter(case.rates)))


def test_unknown_rates_are_refused(case: Case) -> None:
    with pytest.raises(InputError, match="unknown rate 'r99'"):
        case.encode(case.surface(10), "r99")


SPECIAL = {
    "one point": np.array([[3.0, 2.0, 1.0]]),
    "duplicates": np.repeat([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 20, axis=0),
    "collinear": np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)]),
    "negative": -np.arange(60.0).reshape(20, 3),
    "huge": 1e6 + np.arange(60.0).reshape(20, 3) * 1e3,
}


@pytest.mark.parametrize("name", SPECIAL)
def test_special_clouds_come_back(case: Case, name: str) -> None:
    points = case.of_size(SPECIAL[name])
    best = list(case.rates)[-1]
    decoded = case.decode(case.encode(points, best))
    assert decoded.shape[1] == 3
    assert np.isfinite(decoded).all()
    if not _estimates(case.codec):
        assert _farthest(points, decoded) <= _tolerance(case, points, 1.0)


@pytest.mark.parametrize("case", FAITHFUL, indirect=True)
@settings(max_examples=40)
@given(
    points=arrays(
        np.float64,
        st.tuples(st.integers(1, 60), st.just(3)),
        elements=st.floats(-1e4, 1e4, allow_nan=False, width=32),
    )
)
def test_every_point_comes_back_within_the_finest_rate(case: Case, points: np.ndarray) -> None:
    points = case.of_size(points)
    decoded = case.decode(case.encode(points, list(case.rates)[-1]))
    assert _farthest(points, decoded) <= _tolerance(case, points, 1e-2)
    assert len(decoded) <= len(points)


FAR = np.array([500_000.0, 5_000_001.0, -3_000_000.0])


def test_a_cloud_far_away_decodes_to_the_shifted_decode_of_the_near_one(case: Case) -> None:
    near = case.of_size(np.rint(case.cloud() * (UNITS_PER_METRE if case.is_metric else 1)))
    near -= near.min(axis=0)
    rates = list(case.rates)
    for rate in {rates[0], rates[len(rates) // 2], rates[-1]}:
        decoded = [case.decode(case.encode(cloud, rate)) for cloud in (near, near + FAR)]
        assert np.array_equal(_sorted(decoded[0] + FAR), _sorted(decoded[1]))


def test_a_cloud_at_the_origin_is_coded_as_it_is(case: Case) -> None:
    rate, stream = next(iter(_streams(case).items()))
    assert stream == case.codec.encode(PointCloud(case.cloud()), rate)


@cache
def _stream(case: Case) -> bytes:
    return case.encode(case.surface(300), next(iter(case.rates)))


# Programs of others may crash and hang on damage, under limits: see test_external.
@pytest.mark.parametrize("case", OWN, indirect=True)
@settings(max_examples=300)
@given(data=st.data())
def test_damaged_streams_end_in_one_clean_error_or_points(case: Case, data: st.DataObject) -> None:
    stream = bytearray(_stream(case))
    cut = data.draw(st.integers(0, len(stream)))
    damaged = stream[:cut] if data.draw(st.booleans()) else stream
    for _ in range(data.draw(st.integers(1, 4))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    with suppress(InputError):
        decoded = case.decode(bytes(damaged))
        assert decoded.ndim == 2
        assert np.isfinite(decoded).all()

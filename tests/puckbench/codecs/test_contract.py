"""The contract of codecs of points, over all of the registry that can run here.

A codec with rates of clouds in metres runs a second time, on clouds of a room's size at these.
"""

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
from puckbench.checks.clouds import UNITS_PER_METRE, dense_surface, surface
from puckbench.checks.registry import Check, checks
from puckbench.checks.subject import Subject, estimates
from puckbench.checks.supervision import run_check
from puckbench.codecs import lizip, polopcac, reno
from puckbench.codecs.base import Codec, Parameters
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.external import ExternalCodec
from puckbench.codecs.rates import metric_rates, scaled_rates
from puckbench.codecs.registry import codec_of, codecs, open_codec
from puckbench.codecs.returns_codec import ReturnsCodec
from tests.support.codecs import decode, encode

METRES = " (metres)"
CHECKS = [check for check in checks() if check.name not in ("damage", "cost")]
"""A test below damages more streams, and times are no contract."""


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
        return self.of_size(surface(points))

    def cloud(self) -> np.ndarray:
        return self.of_size(dense_surface() if estimates(self.codec) else surface())


PUBLISHED_WEIGHTS = {
    "reno": f"{reno.PUBLISHED_WEIGHTS}/KITTIDetection.pt",
    "lizip": f"{lizip.PUBLISHED_WEIGHTS}/mlp_c3_h256.bin",
    "polopcac": f"{polopcac.PUBLISHED_WEIGHTS}/ckpt.pt",
}
"""Where codecs look for their authors' weights."""


def _cases() -> list[str]:
    """Names of codecs; those of clouds in metres with a word that says so."""
    opened = {name: open_codec(name) for name in codecs()}
    classes = {name: codec for name, codec in opened.items() if not isinstance(codec, ReturnsCodec)}
    here = [name for name in classes if not why_not_here(classes[name])]
    scaled = [name for name in here if scaled_rates(classes[name].rates)]
    if find_spec("torch"):  # with the random weights of `at_work`
        here += [name for name in PUBLISHED_WEIGHTS if name not in here]
    return scaled + [name + METRES for name in here if metric_rates(classes[name].rates)]


@cache
def _opened(case: str) -> Case:
    return Case(open_codec(case.removesuffix(METRES)), case.endswith(METRES))


NAMES = _cases()
FAITHFUL = [name for name in NAMES if not estimates(_opened(name).codec)]
# Streams of clouds in metres have decoders of their own where there are no others.
OWN = [
    name
    for name in NAMES
    if not isinstance(_opened(name).codec, ExternalCodec)
    and name.removesuffix(METRES) not in set(NAMES) - {name}
]


@pytest.fixture(autouse=True, scope="module")
def at_work(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The working directory, with random weights where codecs look for their authors'."""
    folder = tmp_path_factory.mktemp("contract")
    if find_spec("torch"):
        from tests.support.learned_codecs import save_tiny

        for name, path in PUBLISHED_WEIGHTS.items():
            save_tiny(name, folder / path)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(params=NAMES, scope="module")
def case(request: pytest.FixtureRequest) -> Case:
    case = _opened(request.param)
    case.codec.load()
    return case


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
def _subject(case: Case) -> Subject:
    """The case as the checks of codecs see it."""
    return Subject(case.codec, "metric" if case.is_metric else "scaled")


def _streams(case: Case) -> dict[str, bytes]:
    """Streams of the case's cloud by rate: coded once for all tests."""
    return _subject(case).streams


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_the_codec_passes_the_checks(case: Case, check: Check) -> None:
    outcome, line = run_check(check, _subject(case))
    assert outcome in ("passed", "left out"), line


def test_the_order_of_the_points_does_not_change_the_decoded_set(case: Case) -> None:
    shuffled = np.random.default_rng(0).permutation(case.cloud())
    rate = list(case.rates)[len(case.rates) // 2]
    streams = (_streams(case)[rate], case.encode(shuffled, rate))
    decoded = [case.decode(stream) for stream in streams]
    assert np.array_equal(_sorted(decoded[0]), _sorted(decoded[1]))


def test_the_stream_names_a_codec_that_decodes_it(case: Case) -> None:
    stream = next(iter(_streams(case).values()))
    named = open_codec(codec_of(stream))
    assert np.array_equal(_sorted(decode(named, stream)), _sorted(case.decode(stream)))


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
    "huge": 1e6 + np.arange(60.0).reshape(20, 3) * 1e3,
}


@pytest.mark.parametrize("name", SPECIAL)
def test_special_clouds_come_back(case: Case, name: str) -> None:
    points = case.of_size(SPECIAL[name])
    best = list(case.rates)[-1]
    decoded = case.decode(case.encode(points, best))
    assert decoded.shape[1] == 3
    assert np.isfinite(decoded).all()
    if not estimates(case.codec):
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

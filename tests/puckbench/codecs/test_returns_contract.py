"""The contract of codecs of returns, over all of the registry that can run here."""

import subprocess
import sys
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns
from pointkit.lidar.turns import Turn
from puckbench.codecs.registry import codec_of, codecs, open_codec
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.metrics.sensor_metrics import range_errors
from tests.support.returns import EXAMPLES, homemade, recorded

NAMES = [
    name
    for name, kind in codecs().items()
    if kind.takes == "returns" and open_codec(name).available().ok
]


@pytest.fixture(params=NAMES, scope="module")
def codec(request: pytest.FixtureRequest) -> ReturnsCodec:
    opened = open_codec(request.param)
    assert isinstance(opened, ReturnsCodec)
    opened.load()
    return opened


@pytest.fixture(params=EXAMPLES)
def returns(request: pytest.FixtureRequest, codec: ReturnsCodec) -> Returns:
    made = EXAMPLES[request.param]()
    try:
        codec.check_returns(made)
    except InputError as why:
        pytest.skip(str(why))
    return made


def test_there_are_codecs_of_returns() -> None:
    assert {"puck", "puck_smoothed"} <= set(NAMES)


def test_the_finest_rate_is_exact(codec: ReturnsCodec, returns: Returns) -> None:
    finest = list(codec.metric_rates)[-1]
    decoded = codec.decode_cloud(codec.encode_returns(returns, finest))
    assert decoded.returns is not None
    errors = range_errors(returns, decoded.returns)
    assert errors["range_max_mm"] == errors["returns_lost"] == errors["returns_added"] == 0
    if not codec.estimates:
        assert np.abs(decoded.xyz - returns.points()).max() < 1e-9
    assert len(decoded.xyz) == len(returns.points())
    assert decoded.returns.beams == returns.beams


def test_errors_keep_within_their_bound(codec: ReturnsCodec, returns: Returns) -> None:
    """Half a step; where rate-distortion optimisation may take the next multiple, one more."""
    optimises = "lmbda" in codec.Options.model_fields
    sizes, most, rms = [], [], []
    for rate, parameters in codec.metric_rates.items():
        stream = codec.encode_returns(returns, rate)
        errors = range_errors(returns, codec.decode_returns(stream))
        step_mm = 1000 * max(parameters["step_m"], returns.quantum_m)
        assert errors["range_max_mm"] <= step_mm * (1.5 if optimises else 0.5) + 1e-6
        assert errors["returns_lost"] == errors["returns_added"] == 0
        sizes.append(len(stream))
        most.append(errors["range_max_mm"])
        rms.append(errors["range_rms_mm"])
    assert sizes == sorted(sizes)
    assert most == sorted(most, reverse=True)
    assert rms == sorted(rms, reverse=True)


def test_the_same_returns_give_the_same_bytes(codec: ReturnsCodec) -> None:
    rate = next(iter(codec.metric_rates))
    first = codec.encode_returns(recorded(), rate)
    again = open_codec(codec.name)
    assert again.encode_returns(recorded(), rate) == first
    assert codec_of(first) == codec.name.replace("_key_turns", "")  # a variant's streams are puck's


@pytest.fixture(scope="module")
def decoded_elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The points that a fresh process decodes of a stream of each codec."""
    folder = tmp_path_factory.mktemp("streams")
    for name in NAMES:
        codec = open_codec(name)
        stream = codec.encode_returns(recorded(), next(iter(codec.metric_rates)))
        (folder / name).write_bytes(stream)
    program = (
        "import sys, numpy as np; from puckbench.codecs.registry import open_codec\n"
        "for name in sys.argv[1:]:\n"
        "    np.save(f'{name}.npy', open_codec(name).decode(open(name, 'rb').read()))"
    )
    subprocess.run([sys.executable, "-c", program, *NAMES], cwd=folder, check=True)
    return {name: np.load(folder / f"{name}.npy") for name in NAMES}


def test_streams_decode_in_a_fresh_process(
    codec: ReturnsCodec, decoded_elsewhere: dict[str, np.ndarray]
) -> None:
    stream = codec.encode_returns(recorded(), next(iter(codec.metric_rates)))
    np.testing.assert_array_equal(decoded_elsewhere[codec.name], codec.decode(stream))


def test_nothing_and_bare_points_are_refused(codec: ReturnsCodec) -> None:
    rate = next(iter(codec.metric_rates))
    empty = Turn(np.zeros((1, 4, 5), np.uint16), np.arange(4, dtype=np.uint16))
    with pytest.raises(InputError, match="no return"):
        codec.encode_returns(replace(homemade(), turns=(empty,)), rate)
    with pytest.raises(InputError, match="not bare points"):
        codec.encode(recorded().points(), rate)
    with pytest.raises(InputError, match="the cloud has none"):
        codec.encode_cloud(PointCloud(recorded().points()), rate)


def test_damaged_streams_end_in_one_clean_error_or_returns(codec: ReturnsCodec) -> None:
    stream = codec.encode_returns(recorded(60), next(iter(codec.metric_rates)))
    random = np.random.default_rng(7)
    for _ in range(60):
        damaged = bytearray(stream)
        for place in random.integers(0, len(stream), random.integers(1, 4)):
            damaged[place] = random.integers(0, 256)
        with suppress(InputError):
            codec.decode(bytes(damaged[: random.integers(1, len(stream) + 1)]))

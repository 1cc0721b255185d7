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
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.packets import PacketsCodec
from puckbench.codecs.registry import codec_of, codecs, open_codec
from puckbench.codecs.returns_codec import ReturnsCodec
from puckbench.codecs.storage.packets import check_whole_packets
from puckbench.metrics.sensor_metrics import range_errors
from tests.support.codecs import (
    decode,
    decode_cloud,
    decode_returns,
    encode_cloud,
    encode_returns,
)
from tests.support.returns import EXAMPLES, homemade, recorded

NAMES = [
    name
    for name, kind in codecs().items()
    if issubclass(kind, ReturnsCodec) and not why_not_here(open_codec(name))
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
    if isinstance(codec, PacketsCodec):
        try:
            check_whole_packets(made)
        except InputError as why:
            pytest.skip(str(why))
    return made


def test_there_are_codecs_of_returns() -> None:
    assert {"puck", "puck_smoothed"} <= set(NAMES)


def test_the_finest_rate_is_exact(codec: ReturnsCodec, returns: Returns) -> None:
    finest = list(codec.rates)[-1]
    decoded = decode_cloud(codec, encode_returns(codec, returns, finest))
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
    for rate, parameters in codec.rates.items():
        stream = encode_returns(codec, returns, rate)
        errors = range_errors(returns, decode_returns(codec, stream))
        step_mm = 1000 * max(parameters.get("step_m", 0.002), returns.quantum_m)
        assert errors["range_max_mm"] <= step_mm * (1.5 if optimises else 0.5) + 1e-6
        assert errors["returns_lost"] == errors["returns_added"] == 0
        sizes.append(len(stream))
        most.append(errors["range_max_mm"])
        rms.append(errors["range_rms_mm"])
    assert sizes == sorted(sizes)
    assert most == sorted(most, reverse=True)
    assert rms == sorted(rms, reverse=True)


def test_the_same_returns_give_the_same_bytes(codec: ReturnsCodec) -> None:
    rate = next(iter(codec.rates))
    first = encode_returns(codec, recorded(), rate)
    again = open_codec(codec.name)
    assert encode_returns(again, recorded(), rate) == first
    assert codec_of(first) == codec.name.replace("_key_turns", "")  # a variant's streams are puck's


@pytest.fixture(scope="module")
def decoded_elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The points that a fresh process decodes of a stream of each codec."""
    folder = tmp_path_factory.mktemp("streams")
    for name in NAMES:
        codec = open_codec(name)
        stream = encode_returns(codec, recorded(), next(iter(codec.rates)))
        (folder / name).write_bytes(stream)
    program = (
        "import sys, numpy as np; from puckbench.codecs.registry import open_codec\n"
        "from puckbench.codecs.coding import decoded\n"
        "for name in sys.argv[1:]:\n"
        "    np.save(f'{name}.npy', decoded(open_codec(name), open(name, 'rb').read()).xyz)"
    )
    subprocess.run([sys.executable, "-c", program, *NAMES], cwd=folder, check=True)
    return {name: np.load(folder / f"{name}.npy") for name in NAMES}


def test_streams_decode_in_a_fresh_process(
    codec: ReturnsCodec, decoded_elsewhere: dict[str, np.ndarray]
) -> None:
    stream = encode_returns(codec, recorded(), next(iter(codec.rates)))
    np.testing.assert_array_equal(decoded_elsewhere[codec.name], decode(codec, stream))


def test_nothing_and_bare_points_are_refused(codec: ReturnsCodec) -> None:
    rate = next(iter(codec.rates))
    empty = Turn(np.zeros((1, 4, 5), np.uint16), np.arange(4, dtype=np.uint16))
    with pytest.raises(InputError, match="the cloud is empty"):
        encode_returns(codec, replace(homemade(), turns=(empty,)), rate)
    with pytest.raises(InputError, match="the cloud has none"):
        codec.encode(PointCloud(recorded().points()), rate)
    with pytest.raises(InputError, match="the cloud has none"):
        encode_cloud(codec, PointCloud(recorded().points()), rate)


def test_damaged_streams_end_in_one_clean_error_or_returns(codec: ReturnsCodec) -> None:
    stream = encode_returns(codec, recorded(60), next(iter(codec.rates)))
    random = np.random.default_rng(7)
    for _ in range(60):
        damaged = bytearray(stream)
        for place in random.integers(0, len(stream), random.integers(1, 4)):
            damaged[place] = random.integers(0, 256)
        with suppress(InputError):
            decode(codec, bytes(damaged[: random.integers(1, len(stream) + 1)]))

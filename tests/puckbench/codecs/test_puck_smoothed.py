"""The codec puck_smoothed: streams, range errors, and equal bytes on every processor."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud
from pointkit.lidar.returns import returns_file, write_firings
from puckbench.codecs.registry import open_codec
from puckbench.metrics.sensor_metrics import range_errors
from puckbench.steps.evaluate import Measuring, Originals
from tests.support.codecs import decode, decode_cloud, encode_returns
from tests.support.processors import printed_on_processors
from tests.support.returns import recorded


def rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(errors**2)))


@pytest.mark.parametrize("rate", ["100mm", "2mm"])
def test_streams_are_puck_s_with_a_mark_in_front(rate: str) -> None:
    returns = recorded()
    codec = open_codec("puck_smoothed")
    plain = open_codec("puck", {"options": {"lmbda": codec.options.lmbda}})
    coded, stream = encode_returns(plain, returns, rate), encode_returns(codec, returns, rate)
    assert stream.endswith(coded)
    assert len(stream) == len(coded) + 6
    exact, estimate = decode_cloud(plain, coded), decode_cloud(codec, stream)
    assert exact.returns is not None
    assert estimate.returns is not None
    assert range_errors(exact.returns, estimate.returns)["range_max_mm"] == 0
    assert estimate.xyz.shape == exact.xyz.shape
    lengths = (np.linalg.norm(each.xyz, axis=1, keepdims=True) for each in (estimate, exact))
    along = [each.xyz / length for each, length in zip((estimate, exact), lengths, strict=True)]
    assert np.abs(along[0] - along[1]).max() < 0.02  # lasers are up to 11 mm above the origin
    for wrong, other in ((plain, stream), (codec, coded)):
        with pytest.raises(InputError, match="not a"):
            decode(wrong, other)


def test_range_errors_of_moved_points_are_those_of_the_points(tmp_path: Path) -> None:
    """The lossless rate keeps every range, yet its points lie elsewhere on their rays."""
    returns = recorded()
    cloud = tmp_path / "turns.ply"
    about = {"size": 0, "scale": 1.0, "offset": [0.0, 0.0, 0.0], "peak": 30.0}
    write_cloud(cloud, PointCloud(returns.points(), about=about))
    write_firings(returns_file(cloud), returns)
    originals, rows = Originals(cloud), {}
    for name in ("puck", "puck_smoothed"):
        codec = open_codec(name)
        decoded = decode_cloud(codec, encode_returns(codec, returns, "2mm"))
        rows[name] = Measuring().row(originals, (decoded, {}))
        assert rows[name]["returns_lost"] == rows[name]["returns_added"] == 0
    assert rows["puck"]["range_rms_mm"] == rows["puck"]["range_max_mm"] == 0
    moved = rows["puck_smoothed"]
    assert 0 < moved["range_rms_mm"] < moved["range_max_mm"]
    points = returns.points()
    offsets = np.einsum("ij,ij->i", decoded.xyz - points, points) / np.linalg.norm(points, axis=1)
    # Where another point is the nearest, its offset is less.
    assert moved["range_rms_mm"] == pytest.approx(1000 * rms(offsets), rel=0.2)


_SMOOTH = """
import hashlib
import numpy as np
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode_returns
from tests.support.returns import recorded
digest = hashlib.sha256()
for name in ("puck", "puck_smoothed"):
    codec = open_codec(name)
    for rate in ("50mm", "2mm"):
        stream = encode_returns(codec, recorded(), rate)
        digest.update(stream + np.round(decode(codec, stream), 6).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names instructions of x86-64")
def test_streams_and_points_do_not_depend_on_the_instructions_of_libraries() -> None:
    """The last digits of points do: they come from sines and cosines of the C library."""
    assert len(printed_on_processors(_SMOOTH)) == 1

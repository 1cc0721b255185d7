"""Predictive geometry as a codec of clouds in metres, with and without the sensor's returns."""

from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import write_cloud
from gpcc import syntax
from gpcc.bits import BitReader
from gpcc.grid import unwrap
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns, write_firings
from puckbench.cli import main
from puckbench.codecs.rates import metric_rates
from puckbench.codecs.registry import open_codec
from puckbench.steps.encode import to_code
from tests.support.codecs import decode, encode, encode_cloud, encode_returns
from tests.support.returns import EXAMPLES, homemade, recorded

RATES = list(metric_rates(open_codec("gpcc_predictive").rates))


def _parameter_set(stream: bytes) -> syntax.GeometryParameterSet:
    units = dict(syntax.payloads(unwrap(stream).stream))
    gps = syntax.GeometryParameterSet()
    syntax.geometry_parameter_set(BitReader(units[syntax.GEOMETRY_PARAMETER_SET]), gps)
    return gps


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("rate", ["2mm", "1mm"])
def test_returns_come_back_to_within_the_grid(name: str, rate: str) -> None:
    returns, codec = EXAMPLES[name](), open_codec("gpcc_predictive")
    step = codec.rates[rate]["step_m"]
    decoded = decode(codec, encode_returns(codec, returns, rate))
    rounded = np.rint(returns.points() / step) * step
    assert len(decoded) == len(returns)
    assert np.abs(_sorted(decoded, step) - _sorted(rounded, step)).max() < 1e-9


def _sorted(points: np.ndarray, step: float) -> np.ndarray:
    return points[np.lexsort(np.rint(points / step).T)]


def test_rates_are_ordered_by_bits_and_error() -> None:
    codec, returns = open_codec("gpcc_predictive"), recorded(60)
    streams = [encode_returns(codec, returns, rate) for rate in RATES]
    sizes = [len(stream) for stream in streams]
    assert sizes == sorted(sizes)
    assert sizes[-1] > 2 * sizes[0]
    points = returns.points()
    off = [_mean_off(points, decode(codec, stream)) for stream in streams]
    assert off == sorted(off, reverse=True)


def _mean_off(a: np.ndarray, b: np.ndarray) -> float:
    from scipy.spatial import cKDTree

    return float(cKDTree(b).query(a)[0].mean() + cKDTree(a).query(b)[0].mean())


def test_the_sensor_of_a_recording_stands_in_the_stream() -> None:
    returns: Returns = recorded(60)
    gps = _parameter_set(encode_returns(open_codec("gpcc_predictive"), returns, "1mm"))
    tangents = np.sort(np.tan(np.radians(returns.beams.elevations_deg)))
    assert np.allclose([laser.theta / 2**18 for laser in gps.lasers], tangents, atol=1e-5)
    turn = 1 << (12 + gps.geom_angular_azimuth_scale_log2_minus11)
    rise = np.median(np.diff(returns.turns[0].azimuths.astype(int)) % 36000)
    steps = 36000 * returns.layout.columns_per_block / rise
    assert turn / (gps.geom_angular_azimuth_speed_minus1 + 1) == pytest.approx(steps, rel=0.02)


@pytest.mark.parametrize("name", ["gpcc_angular", "gpcc_predictive"])
def test_a_cloud_is_coded_with_the_returns_beside_it(name: str, tmp_path: Path) -> None:
    codec, returns = open_codec(name), recorded(60)
    path = tmp_path / "turn.ply"
    write_cloud(path, PointCloud(returns.points(), about={"size": 0}))
    alone = encode_cloud(codec, to_code(codec, path), "1mm")
    write_firings(path.with_suffix(".parquet"), returns)
    together = encode_cloud(codec, to_code(codec, path), "1mm")
    assert _parameter_set(alone).geom_angular_mode_enabled_flag == 0
    assert alone == encode(codec, returns.points(), "1mm")
    assert together == encode_returns(codec, returns, "1mm")
    assert len(together) < len(alone)


def test_a_cloud_without_its_sensor_is_said_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "turn.ply", tmp_path / "turn.bin"
    returns = recorded(60)
    write_cloud(path, PointCloud(returns.points(), about={"size": 0}))
    words = ["encode", str(path), str(out), "--codec", "gpcc_predictive", "--rate", "1mm"]
    words += ["--frame", "metric"]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert f"{path}: no returns, so codec gpcc_predictive does without its sensor" in said
    write_firings(path.with_suffix(".parquet"), returns)
    assert main(words) == 0
    assert "no returns" not in capsys.readouterr().err


def test_a_returns_own_firings_need_no_second_block() -> None:
    returns = homemade()
    assert len(encode_returns(open_codec("gpcc_predictive"), returns, "16mm"))


def test_a_bare_stream_holds_no_unit() -> None:
    codec = open_codec("gpcc_predictive", {"options": {"raw": True}})
    with pytest.raises(InputError, match="cannot hold the unit"):
        encode_returns(codec, recorded(60), "1mm")

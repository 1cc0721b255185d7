"""Reflectances and colours through codecs and jobs."""

from pathlib import Path

import numpy as np
import pytest

from puckbench.codecs.registry import open_codec
from puckbench.core.errors import InputError
from puckbench.geometry.attributes import attributes_of
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import read_cloud, write_cloud
from puckbench.jobs.curve_files import read_curve
from puckbench.jobs.decode import Decode
from puckbench.jobs.encode import EncodeCurve
from tests.support.returns import recorded

CODECS = ("gpcc", "gpcc_angular", "gpcc_predictive")
CODING = {"attributes": True, "duplicates": "kept"}


def _cloud(most: int = 255) -> PointCloud:
    random = np.random.default_rng(0)
    return PointCloud(
        random.integers(0, 200, (400, 3)) / 100,
        colours=random.integers(0, 256, (400, 3)).astype(np.uint8),
        fields={"intensity": random.integers(0, most + 1, 400), "time": np.arange(400)},
        about={"size": 0},
    )


def _rows(cloud: PointCloud) -> list[tuple[int, ...]]:
    values = attributes_of(cloud)
    columns = np.column_stack(
        [np.rint(cloud.xyz * 100), *(part.reshape(len(cloud), -1) for part in values.values())]
    )
    return sorted(map(tuple, columns.astype(int).tolist()))


@pytest.mark.parametrize("name", CODECS)
@pytest.mark.parametrize("most", [255, 65535])
def test_attributes_come_back_without_loss_where_positions_do(name: str, most: int) -> None:
    codec, cloud = open_codec(name, {"options": CODING}), _cloud(most)
    stream = codec.encode_cloud(cloud, "2mm")
    assert _rows(open_codec(name).decode_cloud(stream)) == _rows(cloud)
    sizes = codec.attribute_bytes(stream)
    assert sizes.keys() == {"reflectance", "colour"}
    bare = open_codec(name, {"options": {"duplicates": "kept"}}).encode_cloud(cloud, "2mm")
    geometry = len(stream) - sum(sizes.values())
    assert 0 <= geometry - len(bare) < 20  # the attributes' descriptions


@pytest.mark.parametrize("name", ["gpcc_angular", "gpcc_predictive"])
def test_reflectivities_of_returns_come_back(name: str) -> None:
    returns = recorded(60)
    codec = open_codec(name, {"options": CODING})
    decoded = codec.decode_cloud(codec.encode_returns(returns, "1mm"))
    wanted = returns.reflectivities()
    assert wanted is not None
    order, expected = np.lexsort(decoded.xyz.T), np.lexsort(np.rint(returns.points() * 1000).T)
    assert (np.sort(decoded.fields["reflectance"]) == np.sort(wanted)).all()
    assert np.mean(decoded.fields["reflectance"][order] == wanted[expected]) > 0.99


def test_rows_have_the_bits_of_each_attribute_and_what_is_not_coded(tmp_path: Path) -> None:
    cloud = _cloud()
    write_cloud(tmp_path / "cloud.ply", cloud)
    changes = {"options": CODING, "metric_rates": ["100mm", "2mm"], "rates": []}
    EncodeCurve(codec="gpcc", changes=changes).run(tmp_path / "cloud.ply", tmp_path / "curve.zip")
    coded = read_curve(tmp_path / "curve.zip")
    for stream in coded.values():
        parts = [stream.record[f"bpp_{part}"] for part in ("geometry", "reflectance", "colour")]
        assert sum(parts) == pytest.approx(stream.record["bpp"])
        assert stream.record["not_coded"] == "time"
    lossy, exact = (stream.record["bpp_reflectance"] for stream in coded.values())
    assert lossy < exact
    Decode(rate="2mm").run(tmp_path / "curve.zip", tmp_path / "decoded.ply")
    assert _rows(read_cloud(tmp_path / "decoded.ply")) == _rows(cloud)


@pytest.mark.parametrize("value", [0.5, -1.0, np.nan, np.inf, 65536.0])
@pytest.mark.parametrize("rate", ["2mm", "100mm"])
def test_reflectances_that_are_no_whole_numbers_are_refused(value: float, rate: str) -> None:
    values = np.full(400, 3.0)
    values[7] = value
    cloud = PointCloud(_cloud().xyz, fields={"reflectance": values}, about={"size": 0})
    with pytest.raises(InputError, match="reflectance: 1 of 400 values are not whole numbers"):
        open_codec("gpcc", {"options": CODING}).encode_cloud(cloud, rate)

"""Reflectances and colours through codecs and jobs."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import laspy
import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns
from puckbench.codecs.coding import attribute_bytes, why_not_here
from puckbench.codecs.registry import open_codec
from puckbench.geometry.attributes import attributes_of
from puckbench.results.curves import read_curve
from puckbench.results.row_files import read_rows
from puckbench.steps.decode import Decode
from puckbench.steps.encode import Encode
from puckbench.steps.evaluate import Evaluate
from tests.support.codecs import decode_cloud, encode, encode_cloud, encode_returns
from tests.support.returns import dual, recorded, staggered

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
    stream = encode_cloud(codec, cloud, "2mm")
    assert _rows(decode_cloud(open_codec(name), stream)) == _rows(cloud)
    sizes = attribute_bytes(codec, stream)
    assert sizes.keys() == {"reflectance", "colour"}
    bare = encode_cloud(open_codec(name, {"options": {"duplicates": "kept"}}), cloud, "2mm")
    geometry = len(stream) - sum(sizes.values())
    assert 0 <= geometry - len(bare) < 20  # the attributes' descriptions


@pytest.mark.parametrize("name", ["gpcc_angular", "gpcc_predictive"])
def test_reflectivities_of_returns_come_back(name: str) -> None:
    returns = recorded(60)
    codec = open_codec(name, {"options": CODING})
    decoded = decode_cloud(codec, encode_returns(codec, returns, "1mm"))
    reflectances = returns.reflectivities()
    assert reflectances is not None
    order, expected = np.lexsort(decoded.xyz.T), np.lexsort(np.rint(returns.points() * 1000).T)
    assert (np.sort(decoded.fields["reflectance"]) == np.sort(reflectances)).all()
    assert np.mean(decoded.fields["reflectance"][order] == reflectances[expected]) > 0.99


def test_rows_have_the_bits_of_each_attribute_and_what_is_not_coded(tmp_path: Path) -> None:
    cloud = _cloud()
    write_cloud(tmp_path / "cloud.ply", cloud)
    changes = {"options": CODING, "metric_rates": ["100mm", "2mm"], "rates": []}
    Encode(codec="gpcc", repeats=1, entry=changes).run(
        tmp_path / "cloud.ply", tmp_path / "curve.zip"
    )
    coded = read_curve(tmp_path / "curve.zip")
    for stream in coded.values():
        parts = [stream.record[f"bpp_{part}"] for part in ("geometry", "reflectance", "colour")]
        assert sum(parts) == pytest.approx(stream.record["bpp"])
        assert stream.record["not_coded"] == "time"
    lossy, exact = (stream.record["bpp_reflectance"] for stream in coded.values())
    assert lossy < exact
    Decode(codec="gpcc", entry=changes, rate="2mm").run(
        tmp_path / "curve.zip", tmp_path / "decoded.ply"
    )
    assert _rows(read_cloud(tmp_path / "decoded.ply")) == _rows(cloud)


@pytest.mark.parametrize("value", [0.5, -1.0, np.nan, np.inf, 65536.0])
@pytest.mark.parametrize("rate", ["2mm", "100mm"])
def test_reflectances_that_are_no_whole_numbers_are_refused(value: float, rate: str) -> None:
    values = np.full(400, 3.0)
    values[7] = value
    cloud = PointCloud(_cloud().xyz, fields={"reflectance": values}, about={"size": 0})
    with pytest.raises(InputError, match="reflectance: 1 of 400 values are not whole numbers"):
        encode_cloud(open_codec("gpcc", {"options": CODING}), cloud, rate)


@pytest.mark.parametrize("name", ["puck", "jpegxl", "jpegls"])
@pytest.mark.parametrize("made", [recorded, dual, staggered])
def test_codecs_of_returns_code_reflectivities_beside_the_same_ranges(
    name: str, made: Callable[[], Returns]
) -> None:
    returns = made()
    codec, bare = open_codec(name, {"options": {"reflectivities": True}}), open_codec(name)
    if why_not_here(codec):
        pytest.skip(why_not_here(codec))
    stream, without = encode_returns(codec, returns, "2mm"), encode_returns(bare, returns, "2mm")
    values = returns.reflectivities()
    assert values is not None
    (size,) = attribute_bytes(codec, stream).values()
    assert 0 <= len(stream) - size - len(without) < 8  # flags and lengths
    assert attribute_bytes(bare, without) == {}
    decoded = decode_cloud(bare, stream)
    np.testing.assert_array_equal(decoded.xyz, decode_cloud(bare, without).xyz)
    np.testing.assert_array_equal(attributes_of(decoded)["reflectance"], values)


def test_puck_need_not_code_the_reflectivities_of_firings_without_a_return() -> None:
    returns = recorded()
    sizes = {}
    for choice in (True, "returns"):
        codec = open_codec("puck", {"options": {"reflectivities": choice}})
        stream = encode_returns(codec, returns, "2mm")
        sizes[choice] = attribute_bytes(codec, stream)["reflectance"]
        decoded = decode_cloud(codec, stream).returns
        assert decoded is not None
        np.testing.assert_array_equal(decoded.reflectivities(), returns.reflectivities())
        for turn, original in zip(decoded.turns, returns.turns, strict=True):
            kept = original.reflectivities
            if choice == "returns":
                kept = np.where(original.ranges > 0, kept, 0)
            np.testing.assert_array_equal(turn.reflectivities, kept)
    assert sizes["returns"] < sizes[True]


def test_laz_codes_intensities_that_laspy_reads() -> None:
    cloud = _cloud(65535)
    codec = open_codec("laz", {"options": {"intensities": True}})
    stream = encode_cloud(codec, cloud, "2mm")
    assert (laspy.read(BytesIO(stream)).intensity == cloud.fields["intensity"]).all()
    without = encode(open_codec("laz"), cloud.xyz, "2mm")
    assert attribute_bytes(codec, stream) == {"reflectance": len(stream) - len(without)}
    decoded = decode_cloud(open_codec("laz"), stream)
    np.testing.assert_array_equal(decoded.fields["reflectance"], cloud.fields["intensity"])
    assert decode_cloud(open_codec("laz"), without).fields == {}


def test_a_rate_may_have_a_qp_and_lossy_values_either_transform(tmp_path: Path) -> None:
    write_cloud(tmp_path / "cloud.ply", _cloud())
    rates = {f"qp{qp}": {"step_m": 0.001, "qp": qp} for qp in (40, 16)}
    for transform in ("raht", "lifting"):
        changes = {"options": {**CODING, "transform": transform}, "metric_rates": rates}
        Encode(codec="gpcc", repeats=1, entry=changes).run(
            tmp_path / "cloud.ply", tmp_path / "curve.zip"
        )
        Evaluate(codec="gpcc", repeats=1).run(
            tmp_path / "cloud.ply", tmp_path / "curve.zip", tmp_path / "rows"
        )
        coarse, fine = read_rows([tmp_path / "rows"])
        assert coarse["d1_mse"] == fine["d1_mse"] == 0
        assert coarse["bpp_reflectance"] < fine["bpp_reflectance"]
        assert coarse["reflectance_psnr"] < fine["reflectance_psnr"] - 12
        assert coarse["y_psnr"] < fine["y_psnr"] - 12

from collections import Counter
from typing import Any

import numpy as np
import pytest

from gpcc import syntax
from gpcc.bits import BitReader
from gpcc.conformance import FOLDER
from gpcc.grid import MAGIC, unwrap
from pointkit.errors import InputError
from pointkit.files import read_json
from puckbench.codecs.rates import scaled_rates
from puckbench.codecs.registry import codec_class, open_codec
from tests.support.codecs import decode, encode

SCALES = {"r": {"scale": 1.0}, "half": {"scale": 0.5}, "odd": {"scale": 0.7}, "fine": {"scale": 4}}


def _codec(name: str = "gpcc", **options: Any) -> Any:
    return open_codec(name, {"rates": SCALES, "options": options})


def _cloud(points: int = 3000, seed: int = 1) -> np.ndarray:
    """A gently curved surface with noise, part of it at negative coordinates."""
    rng = np.random.default_rng(seed)
    xy = rng.random((points, 2)) * 400 - 100
    return np.column_stack([xy, 30 * np.sin(xy[:, 0] / 50) + rng.normal(0, 1, points)])


def _returned(codec: Any, points: np.ndarray, rate: str = "r") -> np.ndarray:
    return decode(codec, encode(codec, points, rate))


def _bag(points: np.ndarray) -> Counter[tuple[float, ...]]:
    return Counter(map(tuple, points.tolist()))


@pytest.mark.parametrize("name", ["gpcc", "gpcc_arena"])
def test_pcc_arenas_scales(name: str) -> None:
    scales = [rate["scale"] for rate in scaled_rates(codec_class(name).rates).values()]
    assert scales == [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1]


@pytest.mark.parametrize(("rounding", "mean"), [("nearest", 1 / 4), ("truncate", 1)])
def test_the_error_at_scale_1_is_that_of_rounding(rounding: str, mean: float) -> None:
    """Mean square of three errors, uniform in +-1/2 or in [0, 1); spread out, no points merge."""
    rng = np.random.default_rng(0)
    points = 20 * np.arange(20_000)[:, None] % [9973, 8999, 7993] + rng.random((20_000, 3))
    ordered = np.sort(points, axis=0)  # each axis alone: the rounding keeps the order
    back = np.sort(_returned(_codec(rounding=rounding, duplicates="kept"), points), axis=0)
    assert np.mean(np.sum((back - ordered) ** 2, axis=1)) == pytest.approx(mean, rel=0.05)


def test_truncation_changes_nothing_at_a_power_of_two_below_1() -> None:
    points = np.abs(_cloud())
    streams = [encode(_codec(rounding=way), points, "half") for way in ("nearest", "truncate")]
    assert streams[0] == streams[1]


@pytest.mark.parametrize("profile", ["minimal", "ctc", "defaults"])
def test_every_point_of_the_grid_comes_back_as_often_as_it_was_there(profile: str) -> None:
    points = np.rint(_cloud() * 4) / 4
    points = np.vstack([points, points[::3], points[::3], points[:5]])
    back = _returned(_codec("gpcc_lossless", profile=profile), points, "fine")
    assert _bag(back) == _bag(points)


def test_merged_points_come_back_once() -> None:
    points = np.rint(_cloud())
    back = _returned(_codec(), np.vstack([points, points]))
    assert _bag(back) == Counter(dict.fromkeys(_bag(points), 1))


@pytest.mark.parametrize("rate", ["half", "odd"])
def test_points_come_back_at_the_middle_of_their_cells(rate: str) -> None:
    points, scale = _cloud(), SCALES[rate]["scale"]
    cells = np.unique(np.rint(points * scale), axis=0)
    back = _returned(_codec(), points, rate)
    assert np.allclose(np.unique(np.rint(back * scale), axis=0), cells)
    assert np.abs(back * scale - np.rint(back * scale)).max() < 1e-9


@pytest.mark.parametrize("away", [0.0, 1e5, -3e9])
def test_a_unit_of_a_millimetre_codes_metres(away: float) -> None:
    points = _cloud() / 50 + away
    back = _returned(_codec(unit=0.001, duplicates="kept"), points)
    errors = np.sort(back, axis=0) - np.sort(points, axis=0)
    assert np.abs(errors).max() <= 0.0005 + 4 * np.spacing(abs(away))


def test_puckbench_adds_five_bytes_to_a_bare_stream() -> None:
    points = _cloud()
    bare = encode(_codec(raw=True), points, "r")
    assert encode(_codec(), points, "r") == MAGIC + b"\0" + bare
    assert _bag(decode(_codec(), bare)) == _bag(_returned(_codec(), points))


def test_a_bare_stream_cannot_hold_a_unit() -> None:
    with pytest.raises(InputError, match="bare stream cannot hold the unit"):
        encode(_codec(raw=True, unit=0.5), _cloud(), "r")


def test_a_cloud_of_22_bits_is_refused() -> None:
    with pytest.raises(InputError, match="codec gpcc: the cloud spans more than 21 bits at scale"):
        encode(_codec(), np.array([[0, 0, 0], [2.0**22, 0, 0]]), "r")


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (
            {"profile": "best"},
            "profile is 'best', but must be 'minimal', 'ctc', 'spinning' or 'defaults'",
        ),
        ({"rounding": "up"}, "rounding is 'up', but must be 'nearest' or 'truncate'"),
        ({"duplicates": "some"}, "duplicates is 'some', but must be 'merged', 'kept' or 'by_rate'"),
        ({"unit": 0}, "unit is 0, but must be greater than 0"),
        ({"unit": float("nan")}, "unit is nan, but must be a finite number"),
        ({"colour": True}, "colour"),
    ],
)
def test_faults_of_options_are_one_line(options: dict[str, Any], fault: str) -> None:
    with pytest.raises(InputError, match=f"codec gpcc: .*{fault}"):
        _codec(**options)


@pytest.mark.parametrize(("rate", "direct"), [("5mm", 1), ("2mm", 3), ("1mm", 3)])
def test_without_a_sensor_options_are_those_of_papers_on_lidar(rate: str, direct: int) -> None:
    """As in SparsePCGC's and OctAttention's kitti.cfg with loss, in Unicorn's ford.cfg without."""
    stream = encode(open_codec("gpcc_no_sensor"), _cloud() / 100, rate)
    units = dict(syntax.payloads(unwrap(stream).stream))
    gps = syntax.GeometryParameterSet()
    syntax.geometry_parameter_set(BitReader(units[syntax.GEOMETRY_PARAMETER_SET]), gps)
    assert gps.inferred_direct_coding_mode == direct
    assert gps.geom_idcm_rate_minus1 == 31  # planarModeIdcmUse 32
    assert gps.geom_unique_points_flag == (direct == 1)  # mergeDuplicatedPoints
    assert gps.neighbour_avail_boundary_log2_minus1 == 7
    assert gps.intra_pred_max_node_size_log2 == 6
    assert gps.geom_planar_mode_enabled_flag
    assert gps.qtbt_enabled_flag
    assert not gps.geom_angular_mode_enabled_flag


def test_codec_and_tmc13_agree_from_real_coordinates_on() -> None:
    """The points of this conformance stream are whole numbers, many of them negative."""
    about = read_json(FOLDER / "manifest.json")["away_minimal"]
    stream = (FOLDER / "away_minimal.bin").read_bytes()
    raw = {"raw": True, "profile": about["profile"]}
    codec = open_codec("gpcc", {"rates": {"r": {"scale": about["scale"]}}, "options": raw})
    assert encode(codec, decode(open_codec("gpcc"), stream), "r") == stream

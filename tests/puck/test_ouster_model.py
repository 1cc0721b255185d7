"""Returns of sensors like Ouster's: their points, headers and tables."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import Beams, Returns, read_firings, write_firings
from pointkit.lidar.turns import MAX_RANGE, Layout, Turn
from puck.recordings.packet_turns import packet_kind, packets_of
from puck.returns_header import decode_beams, decode_layout, encode_beams, encode_layout
from tests.support.returns import homemade, recorded, staggered


def ouster_points(
    millimetres: np.ndarray, altitudes_deg: Floats, azimuths_deg: Floats, origin_mm: float
) -> Floats:
    """Points of ranges (columns, lasers) by the formula of Ouster's documentation, m, in its frame.

    "Lidar range to XYZ": the encoder is at 2 pi (1 - column / columns); a range is measured from
    the origin of the lidar, and the beam starts `origin_mm` from it.
    """
    columns, n = len(millimetres), origin_mm
    points = []
    for column, laser in zip(*np.nonzero(millimetres), strict=True):
        r = float(millimetres[column, laser])
        encoder = 2 * np.pi * (1 - column / columns)
        azimuth = -2 * np.pi * azimuths_deg[laser] / 360
        altitude = 2 * np.pi * altitudes_deg[laser] / 360
        x = (r - n) * np.cos(encoder + azimuth) * np.cos(altitude) + n * np.cos(encoder)
        y = (r - n) * np.sin(encoder + azimuth) * np.cos(altitude) + n * np.sin(encoder)
        points.append((x, y, (r - n) * np.sin(altitude)))
    return np.array(points) / 1000


@settings(max_examples=20, deadline=None)
@given(
    lasers=st.sampled_from([32, 64, 128]),
    columns=st.sampled_from([512, 1024, 2048, 4096]),
    origin_mm=st.floats(0.0, 40.0),
    seed=st.integers(0, 1000),
)
def test_points_are_those_of_ousters_formula(
    lasers: int, columns: int, origin_mm: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    ranges = np.where(random.random((columns, lasers)) < 0.02, 1, 0) * random.integers(
        500, 1 << 20, (columns, lasers)
    )
    altitudes = np.linspace(45, -45, lasers) + random.normal(0, 0.1, lasers)
    azimuths = np.tile([4.2, 1.4, -1.4, -4.2], lasers // 4)
    beams = Beams(
        tuple(altitudes.tolist()),
        (0.0,) * lasers,
        (0.0,) * lasers,
        azimuths_deg=tuple(azimuths.tolist()),
        radial_mm=(origin_mm,) * lasers,
    )
    turn = Turn(ranges.astype(np.uint32)[None], np.arange(columns, dtype=np.uint16))
    layout = Layout(tuple(range(lasers)), azimuth_steps=columns)
    returns = Returns(beams, layout, (turn,), 0.001, "OS", -origin_mm / 1000)
    x, y, z = returns.points().T  # right, forward, up; Ouster's are forward, left, up
    theirs = ouster_points(ranges, altitudes, azimuths, origin_mm)
    np.testing.assert_allclose(np.column_stack([y, -x, z]), theirs, atol=1e-9)
    assert returns.columns_per_turn == columns


def test_distances_begin_with_the_offset_and_no_return_stays_none() -> None:
    returns = staggered()
    turn = returns.turns[0]
    distances = returns.distances(turn)
    missing = turn.ranges == 0
    assert missing.any()
    assert not distances[missing].any()
    np.testing.assert_allclose(distances[~missing], turn.ranges[~missing] * 0.002 - 0.02767)


def test_headers_of_sensors_without_new_values_are_as_they_were() -> None:
    assert encode_layout(Layout((0, 2, 1), 2, 3, 2)) == bytes([2, 3, 2, 3, 0x20, 0x01])
    returns = homemade()
    angles = [returns.beams.elevations_deg, returns.beams.heights_mm, returns.beams.delays]
    head = b"\xc0\xb8\x02" + bytes([0, 8]) + b"Homemade" + b"\1"  # 40,000 units of 1e-7 m
    assert encode_beams(returns) == head + np.array(angles, "<f8").tobytes()
    assert encode_beams(recorded())[:-4] == b"\xa0\x9c\x01\1\5vlp16"


@settings(max_examples=40, deadline=None)
@given(
    lasers=st.sampled_from([1, 16, 17, 128]),
    steps=st.integers(1, 65536),
    has_shifts=st.booleans(),
    has_radial=st.booleans(),
    offset=st.floats(-1, 1),
    clockwise=st.booleans(),
    seed=st.integers(0, 100),
)
def test_headers_come_back(
    lasers: int,
    steps: int,
    has_shifts: bool,
    has_radial: bool,
    offset: float,
    clockwise: bool,
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    shifts = tuple(random.integers(-16383, 16384, lasers).tolist()) if has_shifts else ()
    order = tuple(random.permutation(lasers).tolist())
    layout = Layout(order, 2, 3, 2, azimuth_steps=steps, shifts=shifts)
    rows = [tuple(row.tolist()) for row in random.normal(0, 20, (6, lasers))]
    beams = Beams(*rows[:3], clockwise, *rows[3 : 6 if has_radial else 5])
    returns = Returns(beams, layout, (), 0.001, "Mine", offset)
    decoded, rest = decode_layout(encode_layout(layout) + b"rest")
    assert (decoded, rest) == (layout, b"rest")
    assert decode_beams(encode_beams(returns), layout) == returns


@pytest.mark.parametrize("cut", range(1, 60))
def test_cut_headers_end_in_one_error(cut: int) -> None:
    returns = staggered()
    layout, beams = encode_layout(returns.layout), encode_beams(returns)
    with pytest.raises(InputError):
        decode_layout(layout[:-cut])
    with pytest.raises(InputError):
        decode_beams(beams[:-cut], returns.layout)


def test_an_offset_that_is_no_number_is_refused() -> None:
    returns = staggered()
    for value in (np.nan, np.inf):
        with pytest.raises(InputError, match="damaged"):
            decode_beams(encode_beams(replace(returns, range_offset_m=value)), returns.layout)


@settings(max_examples=15, deadline=None)
@given(
    lasers=st.sampled_from([32, 128]),
    steps=st.sampled_from([1024, 2048, 36000]),
    kinds=st.sampled_from([1, 2]),
    seed=st.integers(0, 1000),
)
def test_tables_hold_ranges_of_32_bits(
    lasers: int, steps: int, kinds: int, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    random = np.random.default_rng(seed)
    shape = (kinds, 24, lasers)
    turn = Turn(
        random.integers(0, MAX_RANGE + 1, shape, dtype=np.uint32),
        random.integers(0, steps, 24).astype(np.uint16),
        random.integers(0, 1 << 32, 2, dtype=np.uint32),
        random.integers(0, 256, shape, dtype=np.uint8),
    )
    layout = Layout(tuple(range(lasers)), 1, 16, kinds, steps)
    zeros = (0.0,) * lasers
    beams = Beams(zeros, zeros, zeros, radial_mm=(15.806,) * lasers)
    returns = Returns(beams, layout, (turn, turn), 0.001, "OS", -0.015806)
    path = tmp_path_factory.mktemp("table") / "returns.parquet"
    write_firings(path, returns)
    again = read_firings(path)
    assert replace(again, turns=()) == replace(returns, turns=())
    for field in ("ranges", "azimuths", "times", "reflectivities"):
        np.testing.assert_array_equal(getattr(again.turns[1], field), getattr(turn, field))


def test_tables_name_the_unit_of_azimuths_and_only_values_that_are_not_usual(
    tmp_path: Path,
) -> None:
    from pyarrow import parquet

    units, names = [], []
    for returns in (staggered(), homemade()):
        write_firings(tmp_path / "returns.parquet", returns)
        schema = parquet.read_schema(tmp_path / "returns.parquet")
        units.append(schema.field("azimuth").metadata[b"unit"])
        about = json.loads(schema.metadata[b"puckbench_firings"])
        names.append({*about, *about["layout"], *about["beams"]})
    assert units == [b"step (see metadata)", b"0.01 deg"]
    new = {"range_bits", "range_offset_m", "radial_mm", "azimuth_steps", "shifts"}
    assert names[0] - names[1] == new


def test_a_table_with_a_range_beyond_the_limit_is_refused(tmp_path: Path) -> None:
    returns = staggered()
    turn = replace(returns.turns[0], ranges=returns.turns[0].ranges.copy())
    broken = replace(returns, turns=(turn,))
    turn.ranges[0, 0, 0] = MAX_RANGE + 1
    write_firings(tmp_path / "returns.parquet", broken)
    with pytest.raises(InputError, match="exceed 16777215 quanta"):
        read_firings(tmp_path / "returns.parquet")


def test_packets_do_not_hold_ranges_beyond_16_bits() -> None:
    kind = packet_kind(0x22, 0x37)
    ranges = np.ones((1, 24, 16), np.uint32)
    turn = Turn(
        ranges, np.zeros(12, np.uint16), np.zeros(1, np.uint32), np.zeros((1, 24, 16), np.uint8)
    )
    assert packets_of(kind, turn).shape == (1, 1206)
    ranges[0, 3, 2] = 65536
    with pytest.raises(InputError, match="16 bits of a packet"):
        packets_of(kind, turn)

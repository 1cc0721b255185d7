"""Decoding VLP-16 packets: closed forms, an independent decoder's output, and bad packets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pointkit.column_tables import write_column_table
from pointkit.errors import InputError
from pointkit.lidar.return_table import BOTH, LAST, STRONGEST, read_return_table
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packet_turns import decode_packets, returns_of_packets
from puck.recordings.packets import PACKET
from puckbench.recordings.reading import read_recording
from tests.support.capture_lookalike import BOX, ROTATION_HZ, box_capture

DATA = Path(__file__).parents[2] / "data" / "capture"
KINDS = {1: STRONGEST, 2: LAST, 3: BOTH}
CORRECTION = np.asarray(load_sensor("vlp16").vertical_correction_mm) / 1000


def test_points_of_a_box_lie_on_its_walls_in_the_sensors_frame() -> None:
    table = decode_packets(box_capture(60).payloads)
    points = table.xyz
    points[:, 2] -= CORRECTION[table["laser_id"]]
    # 1 mm of rounding, and 0.005 degrees of a block's azimuth: 0.2 mm at these ranges.
    assert np.abs(np.max(np.abs(points) / BOX, axis=1) - 1).max() < 1.3e-3 / BOX.min()


def test_azimuth_and_time_go_on_through_the_firings_of_a_packet() -> None:
    table = decode_packets(box_capture(60, start_deg=0.0).payloads)
    turned = np.degrees(table["azimuth"]) / 360 + table["turn"]
    # 0.005 degrees for the block's own azimuth; the last block is extrapolated from two of them.
    assert np.abs(turned - table["timestamp"] * ROTATION_HZ).max() * 360 < 0.0151
    assert np.all(np.diff(table["timestamp"]) > 0)


def test_a_turn_begins_with_the_packet_that_passes_azimuth_zero() -> None:
    payloads = box_capture(160, start_deg=350.0).payloads
    table, returns = decode_packets(payloads), returns_of_packets(payloads)
    assert np.bincount(table["turn"]).tolist() == [turn.returns for turn in returns.turns]
    packets = np.repeat(np.arange(160), 24 * 15)
    before = table.select((packets < 2) & (table["turn"] == 0))
    after = table.select((packets == 2) & (table["turn"] == 1))
    assert np.degrees(before["azimuth"]).min() >= 350
    assert (np.degrees(after["azimuth"]) > 359).any()
    assert (np.degrees(after["azimuth"]) < 1).any()


def test_firings_without_a_return_have_no_row() -> None:
    table = decode_packets(box_capture(1).payloads)
    assert len(table) == 24 * 15
    assert 2 not in table["laser_id"]


def test_dual_returns_of_one_surface_make_one_row() -> None:
    table = decode_packets(box_capture(2, dual=True).payloads)
    glass = np.isin(table["laser_id"], [4, 9])
    assert set(table["return_kind"][~glass]) == {BOTH}
    behind = table["distance"][glass & (table["return_kind"] == LAST)]
    before = table["distance"][glass & (table["return_kind"] == STRONGEST)]
    assert behind - before == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("mode", "name", "kinds"),
    [(0x37, "strongest", {STRONGEST}), (0x38, "last", {LAST}), (0x39, "dual", {BOTH})],
)
def test_the_mode_of_the_packets_tells_which_returns_they_have(
    mode: int, name: str, kinds: set[int]
) -> None:
    """The bytes are those of the manual; blocks of a dual packet are alike in pairs."""
    packets = box_capture(2).payloads.copy().view(PACKET)
    packets["mode"] = mode
    packets["blocks"][:, :, 1::2] = packets["blocks"][:, :, ::2]
    table = decode_packets(packets.view(np.uint8))
    assert table.about["returns"] == name
    assert set(table["return_kind"]) == kinds
    assert len(table) == 2 * 15 * (12 if mode == 0x39 else 24)


@pytest.mark.parametrize("name", ["single", "dual"])
def test_a_capture_decodes_as_velodyne_decoder_decodes_it(name: str) -> None:
    table = read_recording(DATA / f"{name}.pcap")
    other = np.load(DATA / f"{name}.npz")
    if name == "dual":  # it has the last return before the strongest
        beam = np.cumsum(np.diff(table["timestamp"], prepend=-1.0) > 0)
        table = table.select(np.lexsort([table["return_kind"] != LAST, beam]))
    assert table["laser_id"].tolist() == other["laser_id"].tolist()
    assert table["reflectivity"].tolist() == other["reflectivity"].tolist()
    assert table["return_kind"].tolist() == [KINDS[kind] for kind in other["return_type"]]
    # It rounds azimuths to 0.01 degrees.
    assert np.abs(table.xyz - other["xyz"]).max() < np.radians(0.011) * table["distance"].max()


def test_the_committed_captures_are_what_the_look_alike_makes() -> None:
    from puckbench.recordings.writing import pcap_bytes

    assert pcap_bytes(box_capture(6)) == (DATA / "single.pcap").read_bytes()
    assert pcap_bytes(box_capture(6, dual=True)) == (DATA / "dual.pcap").read_bytes()


def test_the_clock_runs_on_over_the_full_hour() -> None:
    log = box_capture(6)
    stamps = np.ascontiguousarray(log.payloads).view(PACKET)["time_us"][:, 0]
    assert stamps[0] > 3_599_000_000 > stamps[-1]
    assert decode_packets(log.payloads)["timestamp"].max() == pytest.approx(
        6 * 1327.104e-6, rel=3e-3
    )


def test_blocks_left_out_do_not_bend_the_azimuth() -> None:
    log = box_capture(1, start_deg=10.0)
    packets = log.payloads.copy().view(PACKET)
    packets["blocks"]["azimuth"][..., 6:] += 9000
    azimuth = np.degrees(decode_packets(packets.view(np.uint8))["azimuth"])
    assert not np.any((azimuth > 13) & (azimuth < 102))


def test_a_table_survives_its_file(tmp_path: Path) -> None:
    table = read_recording(DATA / "dual.pcap")
    write_column_table(tmp_path / "a.parquet", table)
    again = read_return_table(tmp_path / "a.parquet")
    assert again.about == table.about
    assert all(np.array_equal(again[name], column) for name, column in table.columns.items())


def test_kinds_of_return_have_the_numbers_that_the_file_names(tmp_path: Path) -> None:
    from pyarrow import parquet

    table = read_recording(DATA / "dual.pcap")
    write_column_table(tmp_path / "a.parquet", table)
    field = parquet.read_schema(tmp_path / "a.parquet").field("return_kind")
    output = b" ".join(field.metadata.values()).decode()
    assert f"{STRONGEST} strongest, {LAST} last, {BOTH} both" in output


def test_a_scan_table_is_no_capture_table(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table({"distance": [1.0]}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="not a table of returns, it lacks timestamp"):
        read_return_table(tmp_path / "a.parquet")


@pytest.mark.parametrize(
    ("column", "value", "fault"),
    [
        ("laser_id", 1 << 17, "has 131072, where integers of 16 bits are expected"),
        ("reflectivity", 0.5, "has 0.5, where integers of 16 bits are expected"),
        ("turn", np.nan, "has nan, where integers of 32 bits are expected"),
        ("turn", "one", "holds no numbers"),
        ("timestamp", np.nan, "has a value that is not finite"),
        ("x", np.inf, "has a value that is not finite"),
    ],
)
def test_values_that_no_column_of_a_table_can_have_are_refused(
    column: str, value: Any, fault: str, tmp_path: Path
) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    path = tmp_path / "a.parquet"
    write_column_table(path, read_recording(DATA / "single.pcap"))
    table = parquet.read_table(path)
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    columns[column] = np.full(len(columns[column]), value)
    parquet.write_table(pa.table(columns).replace_schema_metadata(table.schema.metadata), path)
    with pytest.raises(InputError, match=f"{path}: column {column} {fault}"):
        read_recording(path)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("product", 0x31, "packets of Velarray .product 0x31., not of VLP-16, Puck"),
        ("product", 0x7F, "an unknown sensor .product 0x7F"),
        ("mode", 0x12, "return mode 0x12"),
    ],
)
def test_packets_of_another_sensor_are_refused(field: str, value: int, message: str) -> None:
    packets = box_capture(3).payloads.copy().view(PACKET)
    packets[field] = value
    with pytest.raises(InputError, match=message):
        decode_packets(packets.view(np.uint8))


def test_a_damaged_packet_is_named() -> None:
    packets = box_capture(3).payloads.copy().view(PACKET)
    packets["blocks"]["flag"][2, 0, 5] = 0
    with pytest.raises(InputError, match="packet 2 is damaged"):
        decode_packets(packets.view(np.uint8))


def test_no_packet_is_an_error() -> None:
    with pytest.raises(InputError, match="no data packet"):
        decode_packets(np.empty((0, 1206), dtype=np.uint8))


@pytest.mark.parametrize("form", ["pcap", "parquet"])
def test_an_interval_begins_with_its_start_and_ends_before_its_end(
    form: str, tmp_path: Path
) -> None:
    """Of six packets, 1.327 ms apart: those 2.654 to 5.308 ms after the first."""
    path = DATA / "single.pcap"
    whole = read_recording(path)
    if form == "parquet":
        path = tmp_path / "a.parquet"
        write_column_table(path, whole)
    apart = 1327.104e-6
    some = read_recording(path, start_s=1.5 * apart, end_s=3.5 * apart)
    since = whole["timestamp"] - whole["timestamp"][0]
    inside = (since >= 1.5 * apart) & (since < 3.5 * apart)
    if form == "pcap":  # whole packets
        inside = np.isin(np.arange(len(whole)) // (24 * 15), [2, 3])
    assert some["distance"].tolist() == whole["distance"][inside].tolist()
    assert some["timestamp"] == pytest.approx(whole["timestamp"][inside], abs=1e-9)
    assert some.about["source"] == path.name


def test_an_error_names_its_file_once(tmp_path: Path) -> None:
    path = tmp_path / "a.pcap"
    path.write_bytes((DATA / "single.pcap").read_bytes()[:24])
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert str(caught.value).startswith(f"{path}: no whole data packet of a Velodyne")
    assert str(caught.value).count("a.pcap") == 1
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "none.pcap")
    assert str(caught.value).count("none.pcap") == 1

"""Residuals of captures: our own scans of a room, written as packets and read back."""

from __future__ import annotations

import json
import re
import runpy
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats
from pointkit.lidar.sensors import load_sensor
from puck.recordings.packets import PACKET
from puckbench.cli import main
from puckbench.recordings.reading import read_recording
from puckbench.recordings.writing import pcap_bytes, write_pcap
from puckbench.steps.capture_residuals import planes_of_capture
from tests.support.capture_lookalike import box_capture
from tests.support.room_captures import NOISE, ROTATION_HZ, room_scan
from tests.support.sensor_scenes import quad
from virtual_lidar import ScanTable
from virtual_lidar.residual_table import COLUMNS, REAL, joined, read_residuals
from virtual_lidar.walls.detection import PlaneSearch
from virtual_lidar.walls.residuals import (
    RecordedPlanes,
    RecordingOptions,
    recording_options,
    recording_residuals,
)
from virtual_lidar.walls.statistics import plane_statistics, recording_summary

WALL_AHEAD = {"surface": "wall", "box": [[-1.5, 2.2, -0.6], [1.5, 2.8, 0.6]]}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> tuple[ScanTable, Path]:
    """A scan of twelve turns with biases of 8 mm and ray noise of 6.3 mm, and its packets."""
    scan = room_scan(12, noise=NOISE, seed=4)
    path = tmp_path_factory.mktemp("capture") / "room.pcap"
    write_pcap(path, scan)
    return scan, path


@pytest.fixture(scope="module")
def planes(room: tuple[ScanTable, Path]) -> RecordedPlanes:
    return planes_of_capture(room[1], RecordingOptions())


def bias_of(scan: ScanTable) -> Floats:
    """What each laser measures too much, in the mean of its returns, (16,) m."""
    extra = scan["distance_noisy"] - scan["distance"]
    return np.bincount(scan["laser_id"], extra) / np.bincount(scan["laser_id"])


def without_line(values: Floats) -> Floats:
    """What is left of values per laser when a wall's plane has taken their mean and slope."""
    rise = np.tan(np.radians(load_sensor("vlp16").laser_elevation_deg))
    return values - np.polyval(np.polyfit(rise, values, 1), rise)


def test_the_ray_noise_of_a_scan_is_recovered(planes: RecordedPlanes) -> None:
    noise = recording_summary(planes)["ray_noise"]
    # Distances are rounded to 2 mm.
    expected = np.hypot(NOISE["ray_sigma_m"], 0.002 / np.sqrt(12))
    assert noise["sigma_m"] == pytest.approx(expected, rel=0.015)
    assert noise["median_std_m"] == pytest.approx(0.97 * expected, rel=0.02)


def test_the_bias_of_each_laser_is_recovered_on_each_wall(
    room: tuple[ScanTable, Path], planes: RecordedPlanes
) -> None:
    expected = without_line(bias_of(room[0]))
    statistics = plane_statistics(planes)
    assert len(statistics) == 4
    for part in statistics:
        assert part.bias.lasers.tolist() == list(range(16))
        assert np.abs(part.bias.mean_m - expected).max() < 7e-4
        assert part.bias.std_m == pytest.approx(np.std(expected, ddof=1), rel=0.03)


def test_a_plane_is_described_by_its_residuals(planes: RecordedPlanes) -> None:
    (part, *_), (plane, *_) = plane_statistics(planes), recording_summary(planes)["planes"]
    assert plane["rows"] == len(part.residual) == len(part.surface.rows)
    assert plane["std_m"] == pytest.approx(part.residual.std(ddof=1), rel=1e-9)
    assert plane["lasers"] == 16
    own = part.deviation - part.bias.mean_m[part.rows["laser_id"]]
    assert part.noise is not None
    assert plane["unevenness_m"] == pytest.approx(
        np.sqrt(max(own.var() - part.noise.sigma_m**2, 0)), abs=1e-9
    )


def test_a_bias_that_stays_repeats_from_wall_to_wall(planes: RecordedPlanes) -> None:
    summary = recording_summary(planes)
    result = summary["bias_repeatability"]
    assert result["pairs"] == 6
    assert result["correlation"] > 0.99
    assert result["shared_std_m"] == pytest.approx(summary["laser_bias_std_m"], rel=0.01)
    assert max(plane["unevenness_m"] for plane in summary["planes"]) < 0.0015


def test_biases_of_a_recording_are_those_of_its_walls(planes: RecordedPlanes) -> None:
    """Variances are averaged; a plane that is no wall has no part in it."""
    first, *rest = planes.surfaces
    summary = recording_summary(replace(planes, surfaces=[replace(first, kind="floor"), *rest]))
    stds = [plane["laser_bias_std_m"] for plane in summary["planes"]]
    assert summary["laser_bias_std_m"] == pytest.approx(np.linalg.norm(stds[1:]) / np.sqrt(3))
    assert summary["bias_repeatability"]["pairs"] == 3
    assert summary["rows"] == sum(plane["rows"] for plane in summary["planes"])
    assert summary["turns"] == 12


def test_a_table_of_another_decoder_tells_less_of_its_recording(planes: RecordedPlanes) -> None:
    """Nothing was cut off that one would know of, and the kind of returns is not known."""
    about = {"source": "room.csv", "sensor": "VLP-16"}
    bare = replace(planes, table=replace(planes.table, about=about), still=None)
    summary = recording_summary(bare)
    assert (summary["capture"], summary["sensor"]) == ("room.csv", "VLP-16")
    assert (summary["returns"], summary["bytes_cut_off"], summary["shift_m"]) == (None, 0, None)


@pytest.mark.parametrize("interval", [(-0.1, 1), (1, 1), (2, 1), (0, 1, 2), (1,)])
def test_an_interval_begins_with_the_recording_or_later_and_ends_after_that(
    interval: tuple[float, ...],
) -> None:
    assert recording_options({"still_s": (0, 0.1)}).still_s == (0, 0.1)
    with pytest.raises(InputError, match="still_s must be"):
        recording_options({"still_s": interval})


def test_the_table_is_that_of_a_virtual_scans_residuals(planes: RecordedPlanes) -> None:
    table = recording_residuals(planes)
    assert tuple(table.columns) == COLUMNS
    assert set(table["model"]) == {REAL}
    assert set(table["surface"]) == {"wall"}
    assert sorted(table.groupby("run")["distance_m"].first()) == pytest.approx([2.5, 2.5, 3, 3])
    assert set(table["run"]) == {1, 2, 3, 4}
    assert set(table["frame"]) == set(planes.table["turn"])
    assert table["elevation_deg"].abs().max() == 15
    assert table["range_m"].min() >= 2.4
    assert table["residual_m"].std() == pytest.approx(recording_summary(planes)["std_m"], rel=1e-6)


def test_residuals_are_positive_on_the_sensors_side(planes: RecordedPlanes) -> None:
    table = recording_residuals(planes)
    nearer = table["range_m"] * np.cos(table["incidence_rad"]) - table["distance_m"]
    # The vertical correction and the rounding of the distance to 1 cm aside.
    assert np.corrcoef(nearer, table["residual_m"])[0, 1] < -0.9


def test_the_table_joins_one_of_another_model(planes: RecordedPlanes) -> None:
    table = recording_residuals(planes)
    other = table.assign(model=pd.Categorical(["vlp16"] * len(table)))
    both = joined([table, other])
    assert list(both["model"].cat.categories) == [REAL, "vlp16"]


def test_the_residuals_of_a_capture_do_not_change(room: tuple[ScanTable, Path]) -> None:
    first, other = (
        recording_residuals(planes_of_capture(room[1], RecordingOptions())) for _ in range(2)
    )
    pd.testing.assert_frame_equal(first, other)


def test_a_plane_chosen_by_hand_is_the_one_that_is_found(
    room: tuple[ScanTable, Path], planes: RecordedPlanes
) -> None:
    chosen = planes_of_capture(room[1], recording_options({"planes": [WALL_AHEAD]}))
    (item,) = chosen.surfaces
    ahead = max(planes.surfaces, key=lambda surface: -surface.plane.normal[1])
    assert item.distance_m == pytest.approx(ahead.distance_m, abs=1e-3)
    assert item.width_m == pytest.approx(3.0, abs=0.05)


def test_a_table_of_the_returns_serves_as_the_capture(
    room: tuple[ScanTable, Path], planes: RecordedPlanes, tmp_path: Path
) -> None:
    assert main(["capture", str(room[1]), str(tmp_path / "a.parquet")]) == 0
    again = planes_of_capture(tmp_path / "a.parquet", RecordingOptions())
    pd.testing.assert_frame_equal(recording_residuals(again), recording_residuals(planes))


def test_an_interval_given_is_taken_as_it_is(room: tuple[ScanTable, Path]) -> None:
    planes = planes_of_capture(room[1], recording_options({"still_s": [0.2, 0.4]}))
    assert planes.still is None
    times = planes.table["timestamp"]
    assert (times.min(), times.max()) == pytest.approx((0.2, 0.4), abs=0.001)


def test_the_first_turns_of_an_interval_may_be_all_that_count(
    room: tuple[ScanTable, Path],
) -> None:
    planes = planes_of_capture(room[1], recording_options({"most_turns": 5}))
    assert planes.still is not None
    assert planes.still.turns == 12
    assert np.unique(planes.table["turn"]).tolist() == [0, 1, 2, 3, 4]


def test_beams_with_two_returns_do_not_count(tmp_path: Path) -> None:
    (tmp_path / "a.pcap").write_bytes(pcap_bytes(box_capture(320, dual=True)))
    planes = planes_of_capture(tmp_path / "a.pcap", RecordingOptions())
    assert not set(planes.table["laser_id"]) & {2, 4, 9}
    assert sorted({item.kind for item in planes.surfaces}) == ["wall"]


def fails(path: Path, out: Path, capsys: pytest.CaptureFixture[str], **options: Any) -> str:
    """The one line that the command prints when it refuses a capture."""
    words = ["residuals", str(out), "--capture", str(path)]
    assert main([*words, "--capture-options", json.dumps(options)]) == 2
    assert not out.exists()
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert str(path) in line or "capture options" in line
    return line


def test_a_moving_capture_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = ((0, 0, 0, 0, 0, 0, 0), (4 / ROTATION_HZ, 0.2, 0, 0, 0, 0, 0))
    write_pcap(tmp_path / "a.pcap", room_scan(4, path=path, noise=NOISE))
    line = fails(tmp_path / "a.pcap", tmp_path / "a.parquet", capsys)
    assert "the sensor never stands still: from turn to turn" in line


def test_a_capture_without_a_plane_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = quad([-40, -40, 0], [80, 0, 0], [0, 80, 0])
    write_pcap(tmp_path / "a.pcap", room_scan(3, [0, 0, 1.0], mesh=field))
    line = fails(tmp_path / "a.pcap", tmp_path / "a.parquet", capsys)
    assert "no plane of a wall, floor or ceiling" in line


def test_another_sensors_capture_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = box_capture(10)
    log.payloads.view(PACKET)["product"] = 0x31
    (tmp_path / "a.pcap").write_bytes(pcap_bytes(log))
    line = fails(tmp_path / "a.pcap", tmp_path / "a.parquet", capsys)
    assert "packets of Velarray" in line


@pytest.mark.parametrize(
    ("kept", "fault"),
    [(10, "not a packet capture"), (900, "876 bytes of a packet that is not whole")],
)
def test_what_is_left_of_a_capture_is_refused(
    room: tuple[ScanTable, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kept: int,
    fault: str,
) -> None:
    (tmp_path / "a.pcap").write_bytes(room[1].read_bytes()[:kept])
    assert fault in fails(tmp_path / "a.pcap", tmp_path / "a.parquet", capsys)


def test_a_capture_cut_short_is_read_as_far_as_it_goes(
    room: tuple[ScanTable, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = room[1].read_bytes()
    (tmp_path / "a.pcap").write_bytes(data[: len(data) // 2 - 100])
    out = tmp_path / "a.parquet"
    assert main(["residuals", str(out), "--capture", str(tmp_path / "a.pcap"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["bytes_cut_off"] > 0
    assert summary["model"] == REAL
    assert summary["turns"] in {6, 7}
    assert len(summary["planes"]) == 4
    assert len(read_residuals(out)) == summary["rows"]


def test_a_file_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = fails(tmp_path / "none.pcap", tmp_path / "a.parquet", capsys)
    assert "no such file" in line


def test_a_summary_for_people_has_a_line_per_plane(
    room: tuple[ScanTable, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["residuals", str(tmp_path / "a.parquet"), "--capture", str(room[1])]) == 0
    lines = capsys.readouterr().out.splitlines()
    walls = [line.split() for line in lines if line.startswith("  wall ")]
    assert [wall[5] for wall in walls] == ["16"] * 4
    assert all(wall[-1].startswith("0.006") for wall in walls)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"floor": 1}, "capture options: unknown option 'floor'"),
        ({"still_s": [1]}, "still_s must be"),
        ({"still_s": [2, 1]}, "still_s must be"),
        ({"planes": []}, "planes is (), but must have at least 1"),
        (
            {"planes": [{"surface": "roof", "box": WALL_AHEAD["box"]}]},
            "planes.0.surface is 'roof'",
        ),
        ({"planes": [{"surface": "wall"}]}, "the option 'planes.0.box' is missing"),
        ({"planes": [{**WALL_AHEAD, "box": [[0, 0], [1, 1]]}]}, "box must be two corners"),
        ({"planes": [{**WALL_AHEAD, "box": [[0, 0, 0], [1, 0, 1]]}]}, "first corner must be below"),
        ({"planes": [WALL_AHEAD, 7]}, "planes.1 is 7, but must be"),
        ({"search": {"least_lasers": "4"}}, "search.least_lasers is '4'"),
        ({"search": []}, "search is"),
        ({"planes": [{**WALL_AHEAD, "box": [[0, 0, 0], [1, 1, 1]]}]}, "0 returns of the still"),
        ({"planes": [{**WALL_AHEAD, "surface": "floor"}]}, "the plane in its box is wall"),
        ({"still_s": [50, 60]}, "no data packet"),
        ({"sensor": "vlp99"}, "vlp99"),
    ],
)
def test_options_that_cannot_be_used_are_refused(
    room: tuple[ScanTable, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: dict[str, Any],
    fault: str,
) -> None:
    words = ["residuals", str(tmp_path / "a.parquet"), "--capture", str(room[1])]
    assert main([*words, "--capture-options", json.dumps(options)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert fault in line


def test_damaged_packets_of_a_capture_are_left_out(
    room: tuple[ScanTable, Path], tmp_path: Path
) -> None:
    data = bytearray(room[1].read_bytes())
    struct.pack_into("<H", data, 24 + 16 + 42, 0)
    (tmp_path / "a.pcap").write_bytes(data)
    about = read_recording(tmp_path / "a.pcap").about
    assert about["damaged_packets"] == 1
    assert about["packets"] == read_recording(room[1]).about["packets"] - 1


def test_an_interval_too_short_for_a_plane_is_refused(room: tuple[ScanTable, Path]) -> None:
    with pytest.raises(InputError, match="no plane of a wall, floor or ceiling"):
        planes_of_capture(room[1], recording_options({"still_s": (0.0, 0.001)}))


def test_half_a_turn_has_planes_and_no_ray_noise(room: tuple[ScanTable, Path]) -> None:
    planes = planes_of_capture(room[1], recording_options({"still_s": (0.0, 0.05)}))
    summary = recording_summary(planes)
    assert len(summary["planes"]) in {2, 3}
    assert summary["ray_noise"] is None
    assert summary["planes"][0]["unevenness_m"] is None
    assert summary["laser_bias_std_m"] > 0.005


def test_every_option_is_explained_with_its_default() -> None:
    extension = Path(__file__).parents[3] / "docs" / "extensions" / "generated_reference.py"
    lines = runpy.run_path(str(extension))["capture_options"]().splitlines()
    listed = [line for line in lines if line.startswith("*")]
    assert all("): " in line for line in listed)
    shown = dict(re.findall(r"`(\w+)` \((\([^)]*\)|[^)]*)\)", "\n".join(listed)))
    limits = {name: str(field.default) for name, field in PlaneSearch.model_fields.items()}
    assert set(shown) == set(limits) | set(RecordingOptions.model_fields)
    assert limits.items() <= shown.items()

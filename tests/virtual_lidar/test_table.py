from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.lidar.sensors import load_sensor
from tests.support.sensor_scenes import room
from virtual_lidar import COLUMNS, ScanTable, Sweep, open_error_model, read_scan, scan, write_scan
from virtual_lidar.scan_table import write_scan_portions


@pytest.fixture(scope="module")
def table() -> ScanTable:
    sweep = Sweep(duration_s=0.1, azimuth_step_deg=3)
    model = open_error_model("vlp16")
    rng = np.random.default_rng(0)
    return scan(room(), load_sensor("vlp16"), sweep, model, (3, 2, 1.3), rng)


def test_a_scan_comes_back_bit_for_bit(tmp_path: Path, table: ScanTable) -> None:
    write_scan(tmp_path / "scan.parquet", table)
    back = read_scan(tmp_path / "scan.parquet")
    assert back.about == table.about
    for name in COLUMNS:
        assert back[name].dtype == table[name].dtype
        assert np.array_equal(back[name], table[name])


def test_a_scan_in_portions_is_the_same_file_and_its_rows_are_counted(
    tmp_path: Path, table: ScanTable
) -> None:
    rows = np.arange(len(table))
    portions = [table.select(rows < 100), table.select(rows >= 100)]
    assert write_scan_portions(tmp_path / "scan.parquet", iter(portions)) == len(table)
    back = read_scan(tmp_path / "scan.parquet")
    assert all(np.array_equal(back[name], table[name]) for name in COLUMNS)


def test_the_same_scan_gives_the_same_bytes(tmp_path: Path, table: ScanTable) -> None:
    for name in ("one", "two"):
        write_scan(tmp_path / f"{name}.parquet", table)
    assert (tmp_path / "one.parquet").read_bytes() == (tmp_path / "two.parquet").read_bytes()


def test_columns_are_those_of_the_contract_with_units(tmp_path: Path, table: ScanTable) -> None:
    from pyarrow import parquet

    write_scan(tmp_path / "scan.parquet", table)
    schema = parquet.read_schema(tmp_path / "scan.parquet")
    contract = (
        "timestamp frame laser_id yaw pitch distance distance_noisy x y z x_noisy y_noisy z_noisy"
        " incidence object_id primitive_id"
    )
    assert set(contract.split()) <= set(schema.names)
    units = {name: schema.field(name).metadata[b"unit"].decode() for name in schema.names}
    assert (units["timestamp"], units["yaw"], units["x_noisy"]) == ("s", "rad", "m")
    assert str(schema.field("x").type) == "double"


def test_a_selection_keeps_rows_together(table: ScanTable) -> None:
    some = table.select(table["laser_id"] == 3)
    assert len(some) == len(table) / 16
    assert some.xyz.shape == some.xyz_noisy.shape == some.normals.shape == (len(some), 3)
    assert np.array_equal(some.xyz_noisy[:, 1], some["y_noisy"])


def test_a_wrong_file_is_named_in_one_line(tmp_path: Path, table: ScanTable) -> None:
    from pyarrow import parquet

    path = tmp_path / "scan.parquet"
    with pytest.raises(InputError, match=r"scan\.parquet: no such file"):
        read_scan(path)
    path.write_bytes(b"PAR1 not really")
    with pytest.raises(InputError, match=r"scan\.parquet: not a scan table \(Parquet\)"):
        read_scan(path)
    write_scan(path, table)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"scan\.parquet: not a scan table \(Parquet\)"):
        read_scan(path)
    write_scan(path, table)
    parquet.write_table(parquet.read_table(path).drop_columns(["yaw", "nz"]), path)
    with pytest.raises(InputError, match="not a scan table, it lacks yaw, nz"):
        read_scan(path)


def test_a_failed_write_leaves_nothing(tmp_path: Path, table: ScanTable) -> None:
    broken = ScanTable({**table.columns, "yaw": table["yaw"][:-1]}, table.about)
    with pytest.raises(ValueError, match="expected length"):
        write_scan(tmp_path / "scan.parquet", broken)
    assert list(tmp_path.iterdir()) == []

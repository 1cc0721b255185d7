import gzip
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud, sidecar, write_cloud
from pointkit.errors import InputError
from pointkit.files import read_json, write_json
from pointkit.geometry.cloud import PointCloud, UncheckedCloud, check_points


def _cloud(points: int = 50) -> PointCloud:
    rng = np.random.default_rng(1)
    return PointCloud(
        xyz=rng.normal(size=(points, 3)) * 1e3,
        normals=rng.normal(size=(points, 3)).astype(np.float32).astype(np.float64),
        colours=rng.integers(0, 256, (points, 3)).astype(np.uint8),
        labels=np.arange(points, dtype=np.int32),
        about={"scale": 2.0, "offset": [1.0, 2.0, 3.0]},
    )


def test_all_attributes_come_back_as_written(tmp_path: Path) -> None:
    cloud = _cloud()
    write_cloud(tmp_path / "a.ply", cloud)
    back = read_cloud(tmp_path / "a.ply")
    assert np.array_equal(back.xyz, cloud.xyz)
    for name in ("normals", "colours", "labels"):
        assert np.array_equal(getattr(back, name), getattr(cloud, name))
    assert back.about == {**cloud.about, "points": 50}


def test_the_file_is_what_plyfile_and_others_expect(tmp_path: Path) -> None:
    write_cloud(tmp_path / "a.ply", PointCloud(np.array([[1.5, 2.0, -3.0]])))
    raw = (tmp_path / "a.ply").read_bytes()
    header, data = raw.split(b"end_header\n")
    assert b"format binary_little_endian 1.0" in header
    assert b"property double x" in header
    assert np.frombuffer(data, "<f8").tolist() == [1.5, 2.0, -3.0]


def test_ascii_float_and_integer_files_are_read(tmp_path: Path) -> None:
    text = (
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty int x\nproperty float y\n"
        "property double z\nend_header\n1 2.5 3\n4 5 6.25\n"
    )
    (tmp_path / "a.ply").write_text(text)
    assert read_cloud(str(tmp_path / "a.ply")).xyz.tolist() == [[1, 2.5, 3], [4, 5, 6.25]]


def test_scaling_to_metres_undoes_scale_and_offset() -> None:
    points = np.array([[2.0, 4.0, 6.0]])
    assert _cloud().to_metres(points).tolist() == [[2.0, 4.0, 6.0]]
    assert PointCloud(points).to_metres(points).tolist() == points.tolist()


def test_selection_includes_attributes() -> None:
    chosen = _cloud().select(np.array([3, 1]))
    assert chosen.labels is not None
    assert chosen.labels.tolist() == [3, 1]
    assert len(chosen) == 2


@pytest.mark.parametrize(
    ("points", "fault"),
    [
        (np.empty((0, 3)), "empty"),
        (np.array([[0, np.nan, 0.0], [np.inf, 0, 0], [0, 0, 0]]), "2 of 3 points are not finite"),
        (np.zeros((4, 2)), r"shape \(n, 3\)"),
    ],
)
def test_unusable_points_are_refused(points: np.ndarray, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        check_points(points, "it")


@pytest.mark.parametrize("keep", [0, 10, 150, 400])
def test_truncated_files_are_named(tmp_path: Path, keep: int) -> None:
    path = tmp_path / "a.ply"
    write_cloud(path, _cloud(), describe=False)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"a\.ply: "):
        read_cloud(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.ply: no such file"):
        read_cloud(tmp_path / "none.ply")


def test_a_description_says_that_it_is_ours(tmp_path: Path) -> None:
    write_cloud(tmp_path / "a.ply", _cloud())
    about = read_json(tmp_path / "a.json")
    assert about["puckbench"] == "cloud"
    assert about["points"] == 50


@pytest.mark.parametrize(
    ("about", "is_read"),
    [
        ({"source": "a", "points": 50, "scale": 9.0}, False),
        ({"puckbench": "cloud", "points": [50], "scale": 9.0}, False),
        ({"puckbench": "cloud", "points": 49, "scale": 9.0}, False),
        ({"puckbench": "cloud", "scale": 9.0}, True),
        ({"puckbench": "cloud", "points": 50, "scale": 9.0}, True),
    ],
)
def test_only_descriptions_by_puckbench_are_read(
    tmp_path: Path, about: dict[str, object], is_read: bool
) -> None:
    write_cloud(tmp_path / "a.ply", _cloud(), describe=False)
    write_json(tmp_path / "a.json", about)
    assert ("scale" in read_cloud(tmp_path / "a.ply").about) == is_read


def test_a_compressed_file_has_its_description(tmp_path: Path) -> None:
    write_cloud(tmp_path / "a.ply", _cloud())
    packed = tmp_path / "a.ply.gz"
    packed.write_bytes(gzip.compress((tmp_path / "a.ply").read_bytes()))
    assert read_cloud(packed).about == read_cloud(tmp_path / "a.ply").about
    assert sidecar(packed) == tmp_path / "a.json"


def test_counts_add_up_over_several_readings(tmp_path: Path) -> None:
    points = np.vstack([_cloud().xyz, np.zeros((9, 3)), [[np.inf, 0, 0]]])
    np.save(tmp_path / "a.npy", points)
    cloud = read_cloud(tmp_path / "a.npy", drop_invalid=True)
    assert cloud.about == {"dropped_points": 10, "missing_returns": 9}
    assert np.array_equal(cloud.xyz, _cloud().xyz)
    points = np.vstack([cloud.xyz, [[np.nan, 0, 0]]])
    write_cloud(tmp_path / "b.ply", UncheckedCloud(points, about=cloud.about))
    again = read_cloud(tmp_path / "b.ply", drop_invalid=True)
    assert again.about["dropped_points"] == 11
    assert again.about["missing_returns"] == 9


def test_the_description_lies_beside_the_file() -> None:
    assert sidecar(Path("x/room_1.ply")) == Path("x/room_1.json")

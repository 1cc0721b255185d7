"""The adapter of the primitives codec: frames, rates, shared work and the command line."""

from pathlib import Path

import numpy as np
import pytest

import primitive_codec
from cloud_files.meshes import read_mesh
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.measurement import NO_COST
from primitive_codec import RATES, PrimitiveSettings
from puckbench.cli import main
from puckbench.codecs.coding import decoded_surfaces
from puckbench.codecs.primitives import Primitives
from puckbench.codecs.registry import open_codec
from tests.support.codecs import decode, encode

SIZE = np.array([1023.0, 700.0, 500.0])
NOISE = 2.5


def _room(points: int = 60_000, noise: float = NOISE) -> np.ndarray:
    """Points on the six sides of a box in the cube of 1023 units, noisy along the normals."""
    rng = np.random.default_rng(4)
    areas = np.repeat([SIZE[1] * SIZE[2], SIZE[0] * SIZE[2], SIZE[0] * SIZE[1]], 2)
    side = rng.choice(6, points, p=areas / areas.sum())
    xyz = rng.random((points, 3)) * SIZE
    rows, axis = np.arange(points), side // 2
    xyz[rows, axis] = (side % 2) * SIZE[axis] + rng.normal(0, noise, points)
    return xyz


def _to_truth(points: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest side of the box, seen as planes."""
    return np.minimum(np.abs(points), np.abs(points - SIZE)).min(axis=1)


def _codec() -> Primitives:
    codec = open_codec("primitives")
    assert isinstance(codec, Primitives)
    return codec


def test_coordinates_in_metres_far_from_the_origin_come_back() -> None:
    points, codec = _room(), _codec()
    to_grid = points * 0.006 + [4000.0, -250.0, 30.0]
    decoded = (decode(codec, encode(codec, to_grid, "r4")) - [4000.0, -250.0, 30.0]) / 0.006
    assert np.mean(_to_truth(decoded) ** 2) < 0.3 * NOISE**2


@pytest.mark.parametrize("away", [0.0, 5e6], ids=["near", "far"])
def test_the_mesh_is_where_the_points_are_and_labelled_with_planes(away: float) -> None:
    codec = _codec()
    stream = encode(codec, _room() + away, "r4")
    mesh, decoded = decoded_surfaces(codec, stream), decode(codec, stream)
    assert mesh.labels is not None
    chosen = np.array([p.parameters["normal"] for p in mesh.labels.primitives])
    offsets = np.array([p.parameters["offset"] for p in mesh.labels.primitives])
    which = mesh.labels.primitive_id
    middles = mesh.corners().mean(axis=1)
    apart = np.einsum("ij,ij->i", middles, chosen[which]) - offsets[which]
    assert np.abs(apart).max() < 0.01
    assert np.abs(mesh.bounds() - away - [[0, 0, 0], SIZE]).max() < 40
    columns = len(decoded)
    assert len(mesh.triangles) < columns / 10
    assert mesh.areas().sum() == pytest.approx(2 * (1023 * 700 + 1023 * 500 + 700 * 500), rel=0.05)


def test_unknown_parameters_of_a_rate_are_refused() -> None:
    codec = open_codec("primitives", {"rates": {"r1": {"leafs": 3}}})
    with pytest.raises(InputError, match="unknown option 'leafs'"):
        encode(codec, _room(100), "r1")


def test_the_command_line_writes_the_mesh(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(encode(_codec(), _room(), "r4"))
    assert main(["decode", str(tmp_path / "a.bin"), str(tmp_path / "a.ply"), "--as-mesh"]) == 0
    mesh = read_mesh(tmp_path / "a.ply")
    assert mesh.labels is not None
    assert {primitive.kind for primitive in mesh.labels.primitives} == {"plane"}
    assert mesh.bounds() == pytest.approx(np.array([[0, 0, 0], SIZE]), abs=24)


def test_a_codec_of_points_has_no_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.bin").write_bytes(encode(open_codec("draco"), _room(100), "r4"))
    assert main(["decode", str(tmp_path / "a.bin"), str(tmp_path / "a.ply"), "--as-mesh"]) == 2
    assert "a.bin: codec draco: codes points, not surfaces" in capsys.readouterr().err


def test_streams_are_those_of_the_package() -> None:
    points = _room(3000)
    assert encode(_codec(), points, "r2") == primitive_codec.encode(
        points, PrimitiveSettings(**RATES["r2"])
    )


def test_rates_share_the_surface_and_cost_what_they_would_alone() -> None:
    codec, points = _codec(), _room(3000)
    shared = codec.prepare(PointCloud(points))
    assert shared is not None
    for rate, is_shared in (("r5", False), ("r7", True)):
        assert encode(codec, points, rate, shared) == encode(codec, points, rate)
        assert (shared.saved > NO_COST) == is_shared

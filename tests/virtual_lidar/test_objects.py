"""Generated objects: unit size, labels, outward normals, different members."""

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.mesh import Mesh, check_mesh
from tests.support.scenes_residuals import plane_alignment, volume, worst_residual
from virtual_lidar.scenes.objects import CLASSES, MEMBERS, OBJECTS, make_object


def members(kind: str) -> list[Mesh]:
    return [make_object(f"{kind}_{k:02d}", 1, detail=0.3) for k in range(1, MEMBERS + 1)]


def test_there_are_fifteen_classes_of_twelve() -> None:
    assert len(CLASSES) == 15
    assert len(OBJECTS) == len(set(OBJECTS)) == 180


@pytest.mark.parametrize("kind", CLASSES)
def test_members_are_valid_and_distinct(kind: str) -> None:
    made = members(kind)
    for number, mesh in enumerate(made):
        check_mesh(mesh, f"{kind} {number}")
        low, high = mesh.bounds()
        assert (high - low).max() == pytest.approx(1.0)
        assert low[2] == pytest.approx(0.0, abs=1e-9)
        assert (high - low).min() > 0.02
        assert volume(mesh) > 0
        assert worst_residual(mesh) < 1e-8
        assert (plane_alignment(mesh) > 0.99).all()
    outlines = {mesh.vertices.round(6).tobytes() for mesh in made}
    assert len(outlines) == MEMBERS


@pytest.mark.parametrize("kind", ["bottle", "cup", "vase", "hammer", "spectacles", "airplane"])
def test_curved_objects_have_thousands_of_triangles(kind: str) -> None:
    assert 3_000 <= len(make_object(f"{kind}_02", 0).triangles) <= 40_000


def test_the_seed_determines_the_object() -> None:
    first, again, other = (make_object("vase_03", seed, 0.3) for seed in (5, 5, 6))
    assert np.array_equal(first.vertices, again.vertices)
    assert not np.array_equal(first.vertices, other.vertices)


@pytest.mark.parametrize("name", ["chair_00", "chair_13", "chair", "dragon_01"])
def test_unknown_object_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=name):
        make_object(name, 0)

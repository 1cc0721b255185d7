"""The Manhattan frame of a room, and rotations by it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from primitive_codec.manhattan_frame import (
    ROTATION_STEP,
    estimate_manhattan_frame,
    rotate,
    rotate_inverse,
    rotation_matrix,
)


def _box_normals(count: int = 3000) -> np.ndarray:
    rng = np.random.default_rng(0)
    normals = np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1, 1], count)[:, None]
    normals += rng.normal(0, 0.02, normals.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("turn", [(0, 0, 0), (300, -4000, 17), (32767, 0, 0)])
def test_rotations_are_those_of_rotation_vectors(turn: tuple[int, int, int]) -> None:
    expected = Rotation.from_rotvec(np.array(turn) * ROTATION_STEP).as_matrix()
    matrix = rotation_matrix(turn)
    assert np.allclose(matrix, expected)
    assert np.allclose(rotate(_box_normals(), matrix), _box_normals() @ expected.T)
    assert np.allclose(rotate_inverse(_box_normals(), matrix), _box_normals() @ expected)


@pytest.mark.parametrize("degrees", [(0, 0, 30), (10, 5, 40), (3, -2, 1)])
def test_the_manhattan_frame_of_a_rotated_box_undoes_its_rotation(
    degrees: tuple[float, float, float],
) -> None:
    turned = Rotation.from_rotvec(degrees, degrees=True).as_matrix()
    back = rotation_matrix(estimate_manhattan_frame(_box_normals() @ turned.T)) @ turned
    assert np.allclose(np.sort(np.abs(back), axis=1), [0, 0, 1], atol=0.01)


def test_the_frame_of_a_single_wall_has_an_axis_along_its_normal() -> None:
    normal = np.array([0.21, -0.13, 1.0]) / np.sqrt(0.21**2 + 0.13**2 + 1)
    normals = normal + np.random.default_rng(0).normal(0, 0.02, (2000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turned = rotation_matrix(estimate_manhattan_frame(normals)) @ normal
    assert np.sort(np.abs(turned))[2] == pytest.approx(1, abs=1e-3)


def test_no_manhattan_frame_is_estimated_for_aligned_boxes_and_spheres() -> None:
    rng = np.random.default_rng(1)
    sphere_normals = rng.normal(size=(4000, 3))
    sphere_normals /= np.linalg.norm(sphere_normals, axis=1, keepdims=True)
    assert estimate_manhattan_frame(_box_normals()) == (0, 0, 0)
    assert estimate_manhattan_frame(sphere_normals) == (0, 0, 0)

"""Turns of SemanticKITTI with which Inter-LPCM's authors test their codec, and their registration.

References
----------
github.com/SDUChangSun/Inter-LPCM: ``test/000001.bin`` as in KITTI; ``test_matrix/000001.bin``, a
matrix (4, 4) of float32 by rows that maps points of the turn before to this turn. ``s_r.py`` finds
it by ICP between the two turns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pointkit.errors import InputError
from pointkit.files import read_bytes
from pointkit.geometry.cloud import Floats
from puckbench.scene_sets.base import Count, select_names
from puckbench.scene_sets.kitti import TURNED, Kitti
from puckbench.scene_sets.registry import LOADERS
from puckbench.scene_sets.scene import Scene

CODE = ("puckbench.scene_sets.kitti",)

_PART, _PUBLISHED = "test", 20
_MATRIX_BYTES = 64
_TOLERANCE = 1e-3
"""Largest deviation of a rotation's rows from a right angle and from length 1."""


@LOADERS.register("inter_lpcm")
class InterLpcm(Kitti):
    """The scenes are the 20 consecutive turns of SemanticKITTI in Inter-LPCM's repository.

    The folder contains ``test/000001.bin`` and ``test_matrix/000001.bin``, or is a clone of the
    repository. Scenes are named test_000001. The points and the axes are as for KITTI. The points
    are corrected for the car's motion, so `returns` reproduces them only roughly. With the option
    `registered`, scenes have the poses that follow from the authors' matrices: estimates by ICP
    between two turns each, not the truth.
    """

    licence = "CC BY-NC-SA 3.0 (KITTI); matrices: MIT"
    credit = (
        'A. Geiger, P. Lenz, R. Urtasun, "Are we ready for Autonomous Driving?", CVPR 2012; '
        "J. Behley et al., SemanticKITTI, 2019; SDUChangSun, Inter-LPCM"
    )
    expected = "expected test/000001.bin, ...; download: puckbench data inter_lpcm_turns"
    collection = "Inter-LPCM"

    registered: bool = False
    """Whether scenes have poses, by the authors' matrices from turn to turn."""

    def files(self, name: str) -> list[Path]:
        frame = self.file_of(name)
        last = self._all.index(frame) if self.registered else 0
        return [frame, *map(_matrix_file, self._all[1 : last + 1])]

    def counts(self) -> list[Count]:
        return [Count("turns", len(self._whole().names()), _PUBLISHED)]

    def listed(self, folder: Path) -> Mapping[str, Path]:
        frames = sorted((folder / _PART).glob("[0-9]*.bin"))
        select_names("parts", self.parts, [_PART])
        if not frames:
            raise self.missing("turns (.bin)")
        return {f"{_PART}_{frame.stem}": frame for frame in frames[:: self.every]}

    def load(self, name: str) -> Scene:
        scene = super().load(name)
        if not self.registered:
            return scene
        pose = np.eye(4)
        for path in self.files(name)[1:]:
            pose = pose @ np.linalg.inv(read_matrix(path))
        return replace(scene, pose=pose @ TURNED if self.returns else pose)

    @cached_property
    def _all(self) -> list[Path]:
        """Paths of the turns' files, in their order, also of turns that options leave out."""
        whole = self._whole()
        return [whole.file_of(name) for name in whole.names()]


def _matrix_file(frame: Path) -> Path:
    return frame.parent.parent / "test_matrix" / frame.name


def read_matrix(path: Path) -> Floats:
    """Read the matrix (4, 4) of a file, which maps points in m of the turn before to this turn.

    Raises InputError if the file is not such a matrix: a rotation and a translation.
    """
    data = read_bytes(path)
    values = np.frombuffer(data, "<f4") if len(data) == _MATRIX_BYTES else np.zeros(16)
    matrix: Floats = values.astype(np.float64).reshape(4, 4)
    if not _is_motion(matrix):
        raise InputError(f"{path}: not a matrix of a motion (16 values of float32)")
    return matrix


def _is_motion(matrix: Floats) -> bool:
    if not np.isfinite(matrix).all():
        return False
    turned = matrix[:3, :3]
    is_orthogonal = np.abs(turned @ turned.T - np.eye(3)).max() < _TOLERANCE
    is_turned = is_orthogonal and np.linalg.det(turned) > 0
    return bool(is_turned and (matrix[3] == [0, 0, 0, 1]).all())

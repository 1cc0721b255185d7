"""A stream's geometric primitives against the labels of the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from puckbench import __version__
from puckbench.core.errors import InputError, naming
from puckbench.core.files import write_json
from puckbench.geometry.cloud import PointCloud
from puckbench.geometry.mesh import Labels, Mesh
from puckbench.io.clouds import read_cloud
from puckbench.io.meshes import read_mesh
from puckbench.jobs.codecs import CodecJob, read_record
from puckbench.jobs.registry import JOBS

_KEPT = ("codec", "rate", "codec_version", "points_in", "bytes", "bpp")
"""What a row keeps of the record beside a stream."""


class LabelledPoints:
    """True points with the labels of the primitives that they lie on, and those primitives.

    Parameters
    ----------
    points
        The points.
    scene
        The labelled mesh that they lie on, in metres.

    Raises
    ------
    InputError
        There are no labels, or they do not fit.
    """

    def __init__(self, points: Path, scene: Path) -> None:
        self.cloud, self.labels = read_cloud(points), _scene_labels(scene)
        _check_points(points, self.cloud, self.labels)


class Recovering(CodecJob):
    """A job that compares primitives of decoded surfaces with those that the scene is made of."""

    dataset: str | None = None

    def recovered(self, originals: LabelledPoints, name: str, stream: Path) -> dict[str, Any]:
        """The result row of a stream; ``kinds`` is empty for one without surface.

        name: of the cloud.
        """
        codec, surface = self._decoded_surface(stream)
        record = read_record(stream)
        kinds = [] if surface is None else _kinds(originals.cloud, originals.labels, surface)
        return {
            **({"dataset": self.dataset} if self.dataset else {}),
            "cloud": name,
            "codec": codec,
            **{key: record[key] for key in _KEPT if key in record},
            "puckbench_version": __version__,
            "kinds": kinds,
        }

    def _decoded_surface(self, path: Path) -> tuple[str, Mesh | None]:
        """The codec's name and the labelled surface; None where the stream holds points alone."""
        name, stream = self.read_stream(path)
        with naming(path):
            codec = self.loaded(name)
            if not codec.has_surfaces:
                raise InputError(f"codec {name} codes points, and no surfaces with primitives")
            try:
                surface = codec.decode_mesh(stream)
            except InputError:
                codec.decode(stream)  # a damaged stream ends here, in the decoder's words
                return name, None
        if surface.labels is None:
            raise InputError(f"{path}: codec {name} gives its surface no labels")
        return name, surface


@JOBS.register("recovery")
class Recovery(Recovering):
    """Compare the primitives of a decoded surface with those that the scene is made of."""

    def run(
        self, stream: Path, points: Path, scene: Path, row: Path | None = None
    ) -> dict[str, Any]:
        """Write the result row and return it.

        Parameters
        ----------
        points, scene
            As `LabelledPoints` takes them.
        """
        result = self.recovered(LabelledPoints(points, scene), points.stem, stream)
        if row:
            write_json(row, result)
        return result


def _kinds(cloud: PointCloud, labels: Labels, surface: Mesh) -> list[dict[str, Any]]:
    """Recovery of each kind of primitive, all in metres."""
    from puckbench.metrics.recovery import Segmentation, decoded_in_metres, recovery

    assert cloud.labels is not None  # noqa: S101 (checked where read)
    true = Segmentation(cloud.labels.astype(np.int64), labels.primitives)
    return recovery(true, decoded_in_metres(surface, cloud), cloud.to_metres(cloud.xyz))


def _scene_labels(path: Path) -> Labels:
    labels = read_mesh(path).labels
    if labels is None:
        raise InputError(f"{path}: the mesh has no labels of primitives")
    return labels


def _check_points(path: Path, cloud: PointCloud, labels: Labels) -> None:
    """InputError unless each point has a label that is one of the scene's primitives."""
    if cloud.labels is None:
        raise InputError(f"{path}: the points have no labels")
    if cloud.labels.min() < 0 or cloud.labels.max() >= len(labels.primitives):
        raise InputError(f"{path}: a point has a label that the scene does not list")

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cloud_files.clouds import read_cloud
from cloud_files.meshes import read_mesh
from pointkit.errors import InputError, naming
from pointkit.files import write_json
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Labels, Mesh
from puckbench import __version__
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded, decoded_surfaces
from puckbench.core.code import CODEC, MESH_FILES
from puckbench.jobs.codec_jobs import CodecJob
from puckbench.jobs.curve_files import Coded, read_coded, read_curve, write_rows
from puckbench.jobs.registry import JOBS

CODE = (
    *(*MESH_FILES, *CODEC, "puckbench.geometry.closest", "puckbench.metrics.recovery"),
    "puckbench.metrics.primitive_differences",
)

_KEPT = ("codec", "rate", "codec_version", "points_in", "bytes", "bpp")
"""Entries of a stream's record that a row of results repeats."""


class LabelledPoints(NamedTuple):
    """The truth with which decoded geometric primitives are compared.

    Parameters
    ----------
    cloud
        True points, each labelled with the index of its primitive.
    labels
        The primitives of the scene, in metres.
    """

    cloud: PointCloud
    labels: Labels


class Recovering(CodecJob):
    """Base class of jobs that compare decoded geometric primitives with a scene's labels."""

    dataset: str | None = None

    def recovered(self, originals: LabelledPoints, name: str, coded: Coded) -> dict[str, Any]:
        """Return the results of one stream by column name.

        Parameters
        ----------
        originals
            The labelled points and primitives of the scene.
        name
            Name of the cloud.
        coded
            The stream and its record.

        Returns
        -------
        dict[str, Any]
            Facts about the stream and, as ``kinds``, a list with the results for each kind of
            primitive, which is empty if the stream has no surface.
        """
        codec, surface = self._decoded_surface(coded)
        record = coded.record
        kinds = [] if surface is None else _kinds(originals.cloud, originals.labels, surface)
        return {
            **({"dataset": self.dataset} if self.dataset else {}),
            "cloud": name,
            "codec": codec,
            **{key: record[key] for key in _KEPT if key in record},
            "puckbench_version": __version__,
            "kinds": kinds,
        }

    def _decoded_surface(self, coded: Coded) -> tuple[str, Mesh | None]:
        name = self.codec_of(coded)
        codec = self.loaded(name)
        if type(codec).surfaces is Codec.surfaces:
            raise InputError(f"codec {name} does not encode surfaces with primitives")
        try:
            surface = decoded_surfaces(codec, coded.stream)
        except InputError:
            decoded(codec, coded.stream)  # raises the decoder's error for a damaged stream
            return name, None
        if surface.labels is None:
            raise InputError(f"codec {name} decodes a surface without labels")
        return name, surface


@JOBS.register("recovery")
class Recovery(Recovering):
    """Decode the geometric primitives of one stream, and compare them with the scene's labels.

    `rate` is the name of the rate to decode if the file is a curve with several rates.
    """

    rate: str | None = None

    def run(
        self, stream: Path, points: Path, scene: Path, row: Path | None = None
    ) -> dict[str, Any]:
        """Return the results of the file `stream`, and write them to `row` (JSON) if it is set.

        `points` is the cloud of labelled true points, and `scene` the mesh with the primitives.
        """
        labelled = _labelled(points, scene)
        with naming(stream):
            result = self.recovered(labelled, points.stem, read_coded(stream, self.rate))
        if row:
            write_json(row, result)
        return result


@JOBS.register("recovery_curve")
class RecoveryCurve(Recovering):
    """Decode the geometric primitives at all rates, and compare them with the scene's labels."""

    def run(self, curve: Path, points: Path, scene: Path, rows: Path) -> dict[str, Any]:
        """Write a row of results for each rate and kind of primitive to `rows` (Parquet).

        `points` is the cloud of labelled true points, and `scene` the mesh with the primitives.
        """
        labelled, coded = _labelled(points, scene), read_curve(curve)
        with naming(curve):
            streams = [self.recovered(labelled, points.stem, item) for item in coded.values()]
        results = [row for stream in streams for row in _row_of_each_kind(stream)]
        write_rows(rows, results)
        return {"rows": len(results)}


def _row_of_each_kind(row: dict[str, Any]) -> list[dict[str, Any]]:
    kinds = row.pop("kinds") or [{"kind": "all"}]
    return [{**row, **kind} for kind in kinds]


def _kinds(cloud: PointCloud, labels: Labels, surface: Mesh) -> list[dict[str, Any]]:
    from puckbench.metrics.recovery import Segmentation, decoded_in_metres, recovery

    assert cloud.labels is not None  # noqa: S101 (checked where read)
    true = Segmentation(cloud.labels.astype(np.int64), labels.primitives)
    return recovery(true, decoded_in_metres(surface, cloud), cloud.to_metres(cloud.xyz))


def _labelled(points: Path, scene: Path) -> LabelledPoints:
    cloud, labels = read_cloud(points), read_mesh(scene).labels
    if labels is None:
        raise InputError(f"{scene}: the mesh has no labels of primitives")
    if cloud.labels is None:
        raise InputError(f"{points}: the points have no labels")
    if cloud.labels.min() < 0 or cloud.labels.max() >= len(labels.primitives):
        raise InputError(f"{points}: a point has a label that the scene does not list")
    return LabelledPoints(cloud, labels)

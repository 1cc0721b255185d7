from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cloud_files.clouds import read_cloud
from cloud_files.meshes import read_mesh
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Labels, Mesh
from puckbench import __version__
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded, decoded_surfaces
from puckbench.core.code import CODEC, MESH_FILES
from puckbench.results.curves import Coded, read_curve
from puckbench.results.row_files import write_rows
from puckbench.steps.coding import CodecStep, planned_codec_step, ready
from puckbench.steps.step import STEPS, PlannedStep

if TYPE_CHECKING:
    from puckbench.planning.workflow import Workflow

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


@STEPS.register("recovery")
class Recovery(CodecStep):
    """Decode the geometric primitives at all rates, and compare them with the scene's labels.

    `dataset` is the name of the data set, for the rows of results.
    """

    dataset: str

    @classmethod
    def of_plan(cls, flow: Workflow, /, dataset: str, cloud: str, codec: str) -> PlannedStep:
        plan, files = flow.plan, flow.files
        rates = plan.rates(codec, plan.datasets[dataset].frame)
        entry = plan.coding_entry(dataset, codec, rates)
        inputs = {
            **files.described({"points": files.true_points(dataset, cloud)}),
            **files.described({"scene": files.scene(dataset, cloud)}),
            "curve": files.curve(dataset, cloud, codec),
        }
        return planned_codec_step(flow, cls(dataset=dataset, codec=codec, entry=entry), inputs)

    def run(self, curve: Path, points: Path, scene: Path, rows: Path) -> dict[str, Any]:
        """Write a row of results for each rate and kind of primitive to `rows` (Parquet).

        `points` is the cloud of labelled true points, and `scene` the mesh with the primitives.
        """
        truth, coded, codec = (
            labelled_points(points, scene),
            read_curve(curve),
            ready(self.opened()),
        )
        named = {"dataset": self.dataset, "cloud": points.stem}
        with naming(curve):
            streams = [{**named, **recovered(truth, codec, item)} for item in coded.values()]
        results = [row for stream in streams for row in _row_of_each_kind(stream)]
        write_rows(rows, results)
        return {"rows": len(results)}


def recovered(truth: LabelledPoints, codec: Codec, coded: Coded) -> dict[str, Any]:
    """Compare the geometric primitives of one stream with the labels of its scene.

    Parameters
    ----------
    truth
        The labelled points and primitives of the scene.
    codec
        The codec of the stream, ready to decode.
    coded
        The stream and its record.

    Returns
    -------
    dict[str, Any]
        Facts about the stream by name of the column and, as ``kinds``, a list with the results for
        each kind of primitive, which is empty if the stream has no surface.
    """
    surface, record = _decoded_surface(codec, coded), coded.record
    return {
        "codec": codec.name,
        **{key: record[key] for key in _KEPT if key in record},
        "puckbench_version": __version__,
        "kinds": [] if surface is None else _kinds(truth.cloud, truth.labels, surface),
    }


def _decoded_surface(codec: Codec, coded: Coded) -> Mesh | None:
    if type(codec).surfaces is Codec.surfaces:
        raise InputError(f"codec {codec.name} does not encode surfaces with primitives")
    try:
        surface = decoded_surfaces(codec, coded.stream)
    except InputError:
        decoded(codec, coded.stream)  # raises the decoder's error for a damaged stream
        return None
    if surface.labels is None:
        raise InputError(f"codec {codec.name} decodes a surface without labels")
    return surface


def _row_of_each_kind(row: dict[str, Any]) -> list[dict[str, Any]]:
    kinds = row.pop("kinds") or [{"kind": "all"}]
    return [{**row, **kind} for kind in kinds]


def _kinds(cloud: PointCloud, labels: Labels, surface: Mesh) -> list[dict[str, Any]]:
    from puckbench.metrics.recovery import Segmentation, decoded_in_metres, recovery

    assert cloud.labels is not None  # noqa: S101 (checked where read)
    true = Segmentation(cloud.labels.astype(np.int64), labels.primitives)
    return recovery(true, decoded_in_metres(surface, cloud), cloud.to_metres(cloud.xyz))


def labelled_points(points: Path, scene: Path) -> LabelledPoints:
    """Return the true points of a file, with the primitives of the scene's mesh."""
    cloud, labels = read_cloud(points), read_mesh(scene).labels
    if labels is None:
        raise InputError(f"{scene}: the mesh has no labels of primitives")
    if cloud.labels is None:
        raise InputError(f"{points}: the points have no labels")
    if cloud.labels.min() < 0 or cloud.labels.max() >= len(labels.primitives):
        raise InputError(f"{points}: a point has a label that the scene does not list")
    return LabelledPoints(cloud, labels)

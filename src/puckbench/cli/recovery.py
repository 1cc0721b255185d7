"""`puckbench recovery`: a stream's geometric primitives against the labels of the scene."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from puckbench import __version__
from puckbench.cli.codec_options import chosen_codec, codec_arguments
from puckbench.cli.encode import record_file
from puckbench.codecs.registry import codec_of
from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, read_json, write_json
from puckbench.geometry.cloud import PointCloud
from puckbench.geometry.mesh import Labels, Mesh
from puckbench.io.clouds import read_cloud
from puckbench.io.meshes import read_mesh

_KEPT = ("codec", "rate", "codec_version", "points_in", "bytes", "bpp")
"""What a row keeps of the record beside a stream."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("stream", type=Path, help="stream of a codec that codes surfaces")
    parser.add_argument("points", type=Path, help="true points with labels (prepare --truth)")
    parser.add_argument("scene", type=Path, help="labelled mesh (.ply) that they lie on, in metres")
    parser.add_argument("--dataset", help="name of the data set, for the result row")
    parser.add_argument("--row", type=Path, help="write the result row here (JSON)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Compare; the answer is the result row, its ``kinds`` empty for a stream without surface."""
    cloud, labels = read_cloud(options.points), _scene_labels(options.scene)
    _check_points(options.points, cloud, labels)
    name, surface = _decoded_surface(options)
    beside = record_file(options.stream)
    record = read_json(beside) if beside.exists() else {}
    row = {
        **({"dataset": options.dataset} if options.dataset else {}),
        "cloud": options.points.stem,
        "codec": name,
        **{key: record[key] for key in _KEPT if key in record},
        "puckbench_version": __version__,
        "kinds": [] if surface is None else _kinds(cloud, labels, surface),
    }
    if options.row:
        write_json(options.row, row)
    return row


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


def _decoded_surface(options: argparse.Namespace) -> tuple[str, Mesh | None]:
    """The codec's name and the labelled surface; None where the stream holds points alone."""
    stream = read_bytes(options.stream)
    try:
        name = options.codec or codec_of(stream)
        codec = chosen_codec(options, name)
        try:
            surface = codec.decode_mesh(stream)
        except InputError:
            codec.decode(stream)  # a damaged stream ends here, in the decoder's words
            return name, None
    except InputError as error:
        raise InputError(f"{options.stream}: {error}") from error
    if surface.labels is None:
        raise InputError(f"{options.stream}: codec {name} gives its surface no labels")
    return name, surface

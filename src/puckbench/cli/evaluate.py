"""`puckbench evaluate`: distortion of a decoded cloud, or of a coded stream, and what it cost."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from puckbench import __version__
from puckbench.cli.codec_options import codec_arguments
from puckbench.cli.decode import decode_file
from puckbench.cli.encode import record_file
from puckbench.cli.types import whole
from puckbench.core.files import read_json, write_json
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.clouds import read_cloud

_KEPT = ("name", "group", "scale", "diameter", "elongation")
"""What a result row keeps of the reference's description."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("reference", type=Path, help="reference cloud (.ply)")
    parser.add_argument("decoded", type=Path, help="decoded cloud (.ply) or stream to decode")
    parser.add_argument(
        "--truth",
        type=Path,
        help="true surface: mesh or captured room in metres, or cloud in the reference's frame",
    )
    parser.add_argument(
        "--visible", type=Path, help="points seen of the true surface, in the reference's frame"
    )
    parser.add_argument(
        "--clean", type=Path, help="clean scan of the same rays, instead of --visible"
    )
    parser.add_argument(
        "--peak", type=float, help="of the PSNRs (default: the reference's size less 1, or 1023)"
    )
    parser.add_argument(
        "--views", type=whole(0), default=0, help="pixels of six pictures to compare (default: 0)"
    )
    parser.add_argument("--dataset", help="name of the data set, for the result row")
    parser.add_argument("--row", type=Path, help="write the result row here (JSON)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Measure; the answer is the result row."""
    reference = read_cloud(options.reference)
    decoded, record = _decoded(options)
    points = decoded.xyz
    found = measures(reference, points, options.peak or peak_of(reference))
    row = {
        **({"dataset": options.dataset} if options.dataset else {}),
        **{key: reference.about[key] for key in _KEPT if key in reference.about},
        **record,
        "puckbench_version": __version__,
        **found,
        **_seen(reference, decoded, options.views, found),
        **_truth(options, reference, points),
    }
    row["cloud"] = row.pop("name", options.reference.stem)
    if options.row:
        write_json(options.row, row)
    return row


def measures(reference: PointCloud, decoded: Floats, peak: float) -> dict[str, float]:
    """All distortions, in the reference's frame, as PSNR and in metres.

    A PSNR that is infinite, because there is no error, is left out.
    """
    from puckbench.metrics.geometry import distortion
    from puckbench.metrics.psnr import cd_psnr, mpeg_psnr
    from puckbench.metrics.units import in_metres

    found = distortion(reference, decoded)
    width = reference.about.get("diameter") or _diameter(reference)
    psnrs = {**mpeg_psnr(found, peak), **cd_psnr(found, width)}
    finite = {name: value for name, value in psnrs.items() if math.isfinite(value)}
    return {**found, **finite, **in_metres(found, reference.about.get("scale", 1.0))}


def peak_of(reference: PointCloud) -> float:
    """The peak of PSNRs: what the coordinates of a prepared cloud reach at most, else 1023."""
    return float(reference.about.get("size") or 1024) - 1


def _diameter(reference: PointCloud) -> float:
    from puckbench.metrics.diameter import diameter

    return float(diameter(reference.xyz))


def _seen(
    reference: PointCloud, decoded: PointCloud, pixels: int, geometry: Mapping[str, float]
) -> dict[str, float]:
    """Measures of pictures, if asked for, and of colours, where both clouds have them."""
    found: dict[str, float] = {}
    if pixels:
        from puckbench.metrics.views import view_quality

        found |= view_quality(reference, decoded, pixels)
    if reference.colours is not None and decoded.colours is not None:
        from puckbench.metrics.colour import colour_distortion, joint_quality

        colour = colour_distortion(reference, decoded)
        found |= {**colour, "joint_quality": joint_quality(geometry, colour)}
    return {name: value for name, value in found.items() if math.isfinite(value)}


def _decoded(options: argparse.Namespace) -> tuple[PointCloud, dict[str, Any]]:
    if options.decoded.suffix == ".ply":
        return read_cloud(options.decoded), {}
    points, record = decode_file(options.decoded, options)
    beside = record_file(options.decoded)
    return PointCloud(points), {**(read_json(beside) if beside.exists() else {}), **record}


def _truth(options: argparse.Namespace, reference: PointCloud, decoded: Floats) -> dict[str, float]:
    if options.truth is None and options.visible is None and options.clean is None:
        return {}
    from puckbench.geometry.closest import mesh_in_frame
    from puckbench.jobs.surfaces import read_truth
    from puckbench.metrics.truth import scan_distortion, truth_distortion
    from puckbench.metrics.units import in_metres

    seen = options.clean or options.visible
    visible = None if seen is None else read_cloud(seen)
    mesh = None
    if options.truth is not None:
        surface = read_truth(options.truth)
        if isinstance(surface, PointCloud):
            visible = visible or surface
        else:
            mesh = mesh_in_frame(surface, *_frame(reference))
    if visible is None:
        visible = _sampled(mesh, len(reference))
    measure = truth_distortion if options.clean is None else scan_distortion
    found = measure(visible, mesh, decoded)
    return {**found, **in_metres(found, reference.about.get("scale", 1.0))}


def _frame(reference: PointCloud) -> tuple[float, Any]:
    return reference.about.get("scale", 1.0), reference.about.get("offset", (0.0, 0.0, 0.0))


def _sampled(mesh: Any, points: int) -> PointCloud:
    from puckbench.core.seeding import generator
    from puckbench.geometry.sampling import sample_surface

    return sample_surface(mesh, points, generator(0, "evaluate", "truth"))

from __future__ import annotations

import argparse
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import SUFFIXES, wide_colours, write_cloud
from cloud_files.content import COMPRESSED, plain_suffix
from cloud_files.las import refuse_copc, wide_colours_of
from cloud_files.las_rewriting import rewrite_las
from cloud_files.meshes import write_mesh
from cloud_files.point_columns import WIDE_COLOURS
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.cli.codec_options import codec_arguments, decoder_of, timing_of
from puckbench.cli.like import MOST_UNLIKE, Model, check_place, read_models
from puckbench.cli.types import refuse
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import decoded_surfaces
from puckbench.codecs.rates import find_rate
from puckbench.codecs.registry import codec_class, is_codec
from puckbench.geometry.attributes import REFLECTANCE, attributes_of, reflectance_field
from puckbench.geometry.matching import Match, farthest, match_points
from puckbench.geometry.scaling import most_rounded_m
from puckbench.recordings.cloud_export import export_cloud, with_fields_of_returns
from puckbench.recordings.export import OF_POINTS
from puckbench.results.curves import Coded, read_coded
from puckbench.steps.coding import decoded_cloud

_LAS = (".las", ".laz")
_log = logging.getLogger(__name__)


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("stream", type=Path, help="stream to decode")
    text = (
        ".ply, .pcd, .las, .laz, .csv or .bin (KITTI); with ring, time and intensity if the stream "
        "tells them"
    )
    add("out", type=Path, help=text)
    text = "write the surface instead of points, if the stream has one"
    add("--as-mesh", action="store_true", help=text)
    text = (
        "the prepared cloud that was coded (.ply): write the points in metres, where its source "
        "was; or the original cloud (LAS, PLY, PCD, E57, ...): write its header and attributes "
        "too, matched by order or position; or both (--like twice)"
    )
    add("--like", type=Path, action="append", default=[], metavar="CLOUD", help=text)
    add("--rate", help="rate to decode of a curve (coded/DATASET/CLOUD/CODEC.zip)")
    codec_arguments(parser, required=False)


def run(options: argparse.Namespace) -> dict[str, Any]:
    if options.as_mesh:
        refuse(options, {"repeats": 1}, "not with --as-mesh, which is not timed")
        refuse(options, {"like": []}, "not with --as-mesh")
        return _mesh(options)
    stream, out, timing = options.stream, options.out, timing_of(options)
    prepared, original = read_models(tuple(options.like))
    _check_format(out)
    with naming(stream):
        coded = read_coded(stream, options.rate)
        codec = decoder_of(options, coded)
        result = decoded_cloud(codec, coded, timing)
    cloud = replace(result.cloud, about={"source": stream.name, "codec": codec.name})
    if prepared:
        check_place(cloud.xyz, prepared.cloud.xyz, f"{stream}: not coded from {prepared.path}")
        cloud = replace(cloud, xyz=prepared.cloud.to_metres(cloud.xyz))
    cloud = with_fields_of_returns(cloud)
    if not original:
        _write(out, cloud)
        return result.record
    with naming(stream):
        match = _match(cloud.xyz, prepared, original, _reach(codec, coded))
    if {out.suffix.lower(), plain_suffix(original.path)} <= {*_LAS}:
        replaced = _las_dimensions(cloud, original, match.rows)
        rewrite_las(out, original.path, cloud.xyz, match.rows, original.factor, replaced)
    else:
        _write(out, _with_attributes(cloud, original, match.rows))
    lost = {"attributes_lost": match.unused, "attributes_unknown": match.unmatched}
    if any(lost.values()):
        _log.warning("%s: %s", out, _loss(match, len(original.cloud)))
    return {**result.record, "attributes_by": match.by, **lost}


def _check_format(out: Path) -> None:
    """Raise InputError for names of files that cannot be written, before anything is decoded."""
    refuse_copc(out)
    suffix = out.suffix.lower()
    if suffix not in OF_POINTS and suffix in (*SUFFIXES, *COMPRESSED):
        raise InputError(f"{out}: {suffix} is not written: name it {', '.join(OF_POINTS)}")


def _write(out: Path, cloud: PointCloud) -> None:
    if out.suffix.lower() in OF_POINTS[1:]:
        export_cloud(out, cloud)
    else:
        write_cloud(out, cloud)


def _reach(codec: Codec, coded: Coded) -> float | None:
    """Return the largest possible error of a decoded point, in m, or None if it is unknown."""
    name = coded.record.get("rate")
    named_rate = find_rate(codec, name) if name else None
    encoder = str(coded.record.get("codec"))  # another one may decode its streams
    estimates = is_codec(encoder) and getattr(codec_class(encoder), "estimates", False)
    if estimates or named_rate is None or {*named_rate[1]} != {"step_m"}:
        return None
    return float(named_rate[1]["step_m"]) * 3**0.5  # diagonal of a grid cell


def _mesh(options: argparse.Namespace) -> dict[str, Any]:
    coded = read_coded(options.stream, options.rate)
    with naming(options.stream):
        codec = decoder_of(options, coded)
        mesh = decoded_surfaces(codec, coded.stream)
    write_mesh(options.out, mesh, {"source": options.stream.name, "codec": codec.name})
    return {
        "codec": codec.name,
        "bytes": len(coded.stream),
        "vertices": len(mesh.vertices),
        "triangles": len(mesh.triangles),
        "primitives": len(mesh.labels.primitives) if mesh.labels else 0,
    }


def _match(decoded: Floats, prepared: Model | None, original: Model, reach: float | None) -> Match:
    """Match decoded points to original ones; raise InputError if most are far from all of them."""
    fault = f"not coded from {original.path}"
    if prepared:
        if reach is None:
            cloud = prepared.cloud
            reach = farthest(cloud.to_metres(cloud.xyz), decoded) + most_rounded_m(cloud.about)
    else:
        fault += ", unless from a prepared cloud (--like it too)"
        check_place(decoded, original.cloud.xyz, fault)
    match = match_points(original.cloud.xyz, decoded, reach)
    if (share := match.unmatched / len(decoded)) > MOST_UNLIKE:
        off = f"{share:.0%} of the decoded points lie more than {match.reach:.3g} m"
        raise InputError(f"{fault}: {off} off its points")
    return match


def _with_attributes(decoded: PointCloud, original: Model, rows: NDArray[np.int64]) -> PointCloud:
    picked = original.cloud.select(np.maximum(rows, 0))
    colours: NDArray[Any] | None = picked.colours
    if picked.colours is not None and (wide := wide_colours(original.path)) is not None:
        fields = {name: part for name, part in picked.fields.items() if name not in WIDE_COLOURS}
        picked, colours = replace(picked, fields=fields), wide[np.maximum(rows, 0)]
    attributes = (picked.normals, picked.colours, colours, picked.labels, *picked.fields.values())
    for values in attributes:
        if values is not None:
            values[rows < 0] = 0
    if decoded.colours is not None:
        colours = _as_wide(decoded.colours, picked.colours, colours)
    fields = {**decoded.fields, **picked.fields}
    if (reflectances := attributes_of(decoded).get(REFLECTANCE)) is not None:
        names = reflectance_field(original.cloud), reflectance_field(decoded)
        fields.pop(names[1] or REFLECTANCE, None)
        fields[names[0] or names[1] or REFLECTANCE] = reflectances
    return replace(picked, xyz=decoded.xyz, colours=colours, about=decoded.about, fields=fields)


def _las_dimensions(
    decoded: PointCloud, original: Model, rows: NDArray[np.int64]
) -> dict[str, NDArray[Any]]:
    """Return dimensions of a LAS file that the stream holds, and for which it replaces others.

    Rings and times are written only if those of the original file are all 0.
    """
    cloud = _with_attributes(decoded, original, rows)
    names = {"user_data": "ring", "gps_time": "time"}
    dimensions = {
        name: decoded.fields[field]
        for name, field in names.items()
        if field in decoded.fields and name not in original.cloud.fields
    }
    if decoded.colours is not None and cloud.colours is not None:
        narrow = original.cloud.colours is not None and wide_colours(original.path) is None
        colours = cloud.colours if narrow else wide_colours_of(cloud.colours)
        dimensions |= dict(zip(("red", "green", "blue"), colours.T, strict=True))
    if (reflectances := attributes_of(decoded).get(REFLECTANCE)) is not None:
        dimensions["intensity"] = reflectances
    return dimensions


def _as_wide(
    decoded: NDArray[np.uint8], narrow: NDArray[np.uint8] | None, wide: NDArray[Any] | None
) -> NDArray[Any]:
    """Return decoded colours with 16 bits if the original's colours have 16 bits."""
    if wide is None or narrow is None or wide.dtype == np.uint8:
        return decoded
    return np.where(decoded == narrow, wide, decoded.astype(np.uint16) * 257)


def _loss(match: Match, points: int) -> str:
    lost = []
    if match.unused:
        lost.append(
            f"{match.unused:,} of {points:,} points lost their attributes (merged or moved)"
        )
    if match.unmatched:
        where = f"no original point within {match.reach:.3g} m"
        lost.append(f"{match.unmatched:,} decoded points have {where}: their attributes are 0")
    return "; ".join(lost)

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.codecs.facts import find_rate
from puckbench.core.content import plain_suffix
from puckbench.core.errors import InputError, naming
from puckbench.geometry.attributes import REFLECTANCE, attributes_of, reflectance_field
from puckbench.geometry.cloud import PointCloud, bounds
from puckbench.geometry.matching import Match, match_points
from puckbench.io.clouds import read_cloud, write_cloud
from puckbench.io.las import rewrite_las
from puckbench.io.meshes.writing import write_mesh
from puckbench.jobs.curve_files import Coded, read_coded
from puckbench.jobs.decoding import Decoding
from puckbench.jobs.registry import JOBS

LAS = (".las", ".laz")
_log = logging.getLogger(__name__)
_MOST_UNLIKE = 0.5
"""Largest allowed fraction of decoded points that match no original point."""
_Model = tuple[Path, PointCloud]


@JOBS.register("decode")
class Decode(Decoding):
    """Decode a stream, or a rate of a curve, to a cloud or mesh."""

    as_mesh: bool = False
    rate: str | None = None

    def run(self, stream: Path, cloud: Path, like: tuple[Path, ...] = ()) -> dict[str, Any]:
        """Write the decoded cloud, by default in the coordinate frame of the encoded cloud.

        `like` contains a prepared cloud (its description maps points to the source's coordinates),
        an original cloud (its attributes are copied to the points), or both. A LAS or LAZ file gets
        the original's header.
        """
        if self.as_mesh:
            if like:
                raise InputError("--like: not with --as-mesh")
            return self._mesh(stream, cloud)
        prepared, original = _models(like)
        if cloud.suffix.lower() in LAS and (not original or plain_suffix(original[0]) not in LAS):
            raise InputError(f"{cloud}: name it .ply, or name the original LAS file (--like)")
        with naming(stream):
            coded = read_coded(stream, self.rate)
            result = self.decoded(coded)
        about = {"source": stream.name, "codec": result.record["codec"]}
        decoded = replace(result.cloud, about=about)
        if prepared:
            _check_place(decoded, prepared[1], f"{stream}: not coded from {prepared[0]}")
            decoded = replace(decoded, xyz=prepared[1].to_metres(decoded.xyz))
        if not original:
            write_cloud(cloud, decoded)
            return result.record
        fault = f"{stream}: not coded from {original[0]}"
        if not prepared:
            fault += ", unless from a prepared cloud (--like it too)"
        _check_place(decoded, original[1], fault)
        match = match_points(original[1].xyz, decoded.xyz, self._reach(coded))
        if (share := match.unmatched / len(decoded)) > _MOST_UNLIKE:
            off = f"{share:.0%} of the decoded points lie more than {match.reach:.3g} m"
            raise InputError(f"{fault}: {off} off its points")
        if cloud.suffix.lower() in LAS:
            rewrite_las(cloud, original[0], decoded.xyz, match.rows)
        else:
            write_cloud(cloud, _with_attributes(decoded, original[1], match.rows))
        lost = {"attributes_lost": match.unused, "attributes_0": match.unmatched}
        if any(lost.values()):
            _log.warning("%s: %s", cloud, _loss(match, len(original[1])))
        return {**result.record, "attributes_by": match.by, **lost}

    def _reach(self, coded: Coded) -> float | None:
        """Return the diagonal of a grid cell, in m, if the rate is a length, else None."""
        name = coded.record.get("rate")
        named_rate = find_rate(self.loaded(self.codec_of(coded)), name) if name else None
        if named_rate is None or {*named_rate[1]} != {"step_m"}:
            return None
        return float(named_rate[1]["step_m"]) * 3**0.5

    def _mesh(self, path: Path, out: Path) -> dict[str, Any]:
        coded = read_coded(path, self.rate)
        with naming(path):
            name = self.codec_of(coded)
            mesh = self.loaded(name).decode_mesh(coded.stream)
        write_mesh(out, mesh, {"source": path.name, "codec": name})
        return {
            "codec": name,
            "bytes": len(coded.stream),
            "vertices": len(mesh.vertices),
            "triangles": len(mesh.triangles),
            "primitives": len(mesh.labels.primitives) if mesh.labels else 0,
        }


def _check_place(decoded: PointCloud, original: PointCloud, fault: str) -> None:
    low, high = bounds(original.xyz)
    margin = (high - low).max()
    if (decoded.xyz < low - margin).any() or (decoded.xyz > high + margin).any():
        raise InputError(f"{fault}: the decoded points lie elsewhere")


def _models(paths: tuple[Path, ...]) -> tuple[_Model | None, _Model | None]:
    clouds = [(path, read_cloud(path, keep_missing=True)) for path in paths]
    prepared, original = (
        [item for item in clouds if (item[1].frame is None) == is_original]
        for is_original in (False, True)
    )
    if max(len(prepared), len(original)) > 1:
        raise InputError("--like: takes one prepared cloud and one original")
    return next(iter(prepared), None), next(iter(original), None)


def _with_attributes(
    decoded: PointCloud, original: PointCloud, rows: NDArray[np.int64]
) -> PointCloud:
    picked = original.select(np.maximum(rows, 0))
    for values in (picked.normals, picked.colours, picked.labels, *picked.fields.values()):
        if values is not None:
            values[rows < 0] = 0
    decoded_values = decoded.colours, attributes_of(decoded).get(REFLECTANCE)
    if decoded_values[1] is not None:
        name = reflectance_field(original) or REFLECTANCE
        picked = replace(picked, fields={**picked.fields, name: decoded_values[1]})
    colours = picked.colours if decoded_values[0] is None else decoded_values[0]
    return replace(picked, xyz=decoded.xyz, colours=colours, about=decoded.about)


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

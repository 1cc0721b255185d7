from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.clouds import wide_colours, write_cloud
from cloud_files.content import plain_suffix
from cloud_files.las_rewriting import rewrite_las
from cloud_files.meshes import write_mesh
from cloud_files.point_columns import WIDE_COLOURS
from pointkit.errors import InputError, naming
from pointkit.geometry.cloud import Floats, PointCloud
from puckbench.codecs.coding import decoded_surfaces
from puckbench.codecs.rates import find_rate
from puckbench.codecs.registry import codec_class, is_codec
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.geometry.attributes import REFLECTANCE, attributes_of, reflectance_field
from puckbench.geometry.matching import Match, farthest, match_points
from puckbench.jobs.curve_files import Coded, read_coded
from puckbench.jobs.decoding import Decoding
from puckbench.jobs.like import MOST_UNLIKE, Model, check_place, read_models
from puckbench.jobs.registry import JOBS

CODE = (
    *CLOUD_FILES,
    *CODEC,
    "puckbench.jobs.decoding",
    "puckbench.jobs.like",
    "cloud_files.las_rewriting",
    "cloud_files.las",
)

LAS = (".las", ".laz")
_log = logging.getLogger(__name__)


@JOBS.register("decode")
class Decode(Decoding):
    """Decode a stream to a cloud or mesh.

    Parameters
    ----------
    as_mesh
        Whether to decode a mesh; otherwise, a cloud is decoded.
    rate
        Name of the rate to decode, if the file is a curve, i.e. has streams of several rates.
    """

    as_mesh: bool = False
    rate: str | None = None

    def run(self, stream: Path, cloud: Path, like: tuple[Path, ...] = ()) -> dict[str, Any]:
        """Write the decoded cloud or mesh, and return facts about the decoding.

        Parameters
        ----------
        stream
            Stream or curve to decode.
        cloud
            File to write. A LAS or LAZ file requires an original in `like`, whose header it gets.
        like
            Up to two clouds to which decoded points are fitted. With the prepared cloud that was
            encoded, points are moved back to the coordinates before the preparation, in m. With the
            original cloud, points get the attributes of its points. By default, points stay in the
            coordinate frame of the encoded cloud.
        """
        if self.as_mesh:
            if like:
                raise InputError("--like: not with --as-mesh")
            return self._mesh(stream, cloud)
        prepared, original = read_models(like)
        if cloud.suffix.lower() in LAS and not (original and plain_suffix(original.path) in LAS):
            raise InputError(f"{cloud}: name it .ply, or name the original LAS file (--like)")
        with naming(stream):
            coded = read_coded(stream, self.rate)
            result = self.decoded(coded)
        about = {"source": stream.name, "codec": result.record["codec"]}
        decoded = replace(result.cloud, about=about)
        if prepared:
            check_place(
                decoded.xyz, prepared.cloud.xyz, f"{stream}: not coded from {prepared.path}"
            )
            decoded = replace(decoded, xyz=prepared.cloud.to_metres(decoded.xyz))
        if not original:
            write_cloud(cloud, decoded)
            return result.record
        with naming(stream):
            match = _match(decoded.xyz, prepared, original, self._reach(coded))
        if cloud.suffix.lower() in LAS:
            rewrite_las(cloud, original.path, decoded.xyz, match.rows, original.metres_per_unit)
        else:
            write_cloud(cloud, _with_attributes(decoded, original, match.rows))
        lost = {"attributes_lost": match.unused, "attributes_0": match.unmatched}
        if any(lost.values()):
            _log.warning("%s: %s", cloud, _loss(match, len(original.cloud)))
        return {**result.record, "attributes_by": match.by, **lost}

    def _reach(self, coded: Coded) -> float | None:
        """Return the largest possible error of a decoded point, in m, or None if it is unknown."""
        name, codec = coded.record.get("rate"), self.loaded(self.codec_of(coded))
        named_rate = find_rate(codec, name) if name else None
        encoder = str(coded.record.get("codec"))  # another one may decode its streams
        estimates = is_codec(encoder) and getattr(codec_class(encoder), "estimates", False)
        if estimates or named_rate is None or {*named_rate[1]} != {"step_m"}:
            return None
        return float(named_rate[1]["step_m"]) * 3**0.5  # diagonal of a grid cell

    def _mesh(self, path: Path, out: Path) -> dict[str, Any]:
        coded = read_coded(path, self.rate)
        with naming(path):
            name = self.codec_of(coded)
            mesh = decoded_surfaces(self.loaded(name), coded.stream)
        write_mesh(out, mesh, {"source": path.name, "codec": name})
        return {
            "codec": name,
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
            reach = farthest(prepared.cloud.to_metres(prepared.cloud.xyz), decoded)
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
    if (reflectances := attributes_of(decoded).get(REFLECTANCE)) is not None:
        name = reflectance_field(original.cloud) or REFLECTANCE
        picked = replace(picked, fields={**picked.fields, name: reflectances})
    return replace(picked, xyz=decoded.xyz, colours=colours, about=decoded.about)


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

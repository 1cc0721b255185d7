from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from puckbench.core.environment import run_environment
from puckbench.core.errors import InputError, naming, noting
from puckbench.core.measurement import measured
from puckbench.geometry.cloud import PointCloud, bounds, check_points
from puckbench.io.archives import write_archive
from puckbench.io.clouds import cloud_bytes, read_cloud, write_cloud
from puckbench.io.meshes.writing import write_mesh
from puckbench.jobs.codec_jobs import TimedJob
from puckbench.jobs.curve_files import REMARK, Coded, read_coded, read_curve
from puckbench.jobs.registry import JOBS


class Decoded(NamedTuple):
    cloud: PointCloud
    record: dict[str, Any]


class Decoding(TimedJob):
    """Base class of jobs that decode streams; by default, a stream determines its codec."""

    def decoded(self, coded: Coded, again: bool = False) -> Decoded:
        """Decode and time a stream; with `again`, decode a user's codec twice and compare."""
        name = self.codec_of(coded)
        codec = self.loaded(name)
        with noting(f"rate {coded.record.get('rate', '?')}"):
            timed = measured(lambda: codec.decode_cloud(coded.stream), self.repeats, codec.cost)
            check_points(timed.result.xyz, f"codec {name}: decoded points")
            again = again and self.runs_twice(codec)
            differ = again and not np.array_equal(
                codec.decode_cloud(coded.stream).xyz, timed.result.xyz
            )
        remarks = [coded.record.get(REMARK), "repeated decodings differ" if differ else None]
        record = {
            **coded.record,
            **({REMARK: "; ".join(filter(None, remarks))} if any(remarks) else {}),
            "codec": name,
            "bytes": len(coded.stream),
            "points_out": len(timed.result),
            **timed.costs("decode"),
            **run_environment(self.alone),
        }
        return Decoded(timed.result, record)


@JOBS.register("decode")
class Decode(Decoding):
    """Decode a stream, or a rate of a curve, to a cloud or mesh."""

    as_mesh: bool = False
    rate: str | None = None

    def run(self, stream: Path, cloud: Path, like: Path | None = None) -> dict[str, Any]:
        """Write the decoded cloud; if a prepared cloud `like` is given, in its source's metres."""
        if self.as_mesh:
            if like:
                raise InputError("--like: not with --as-mesh")
            return self._mesh(stream, cloud)
        original = None if like is None else _described(like)
        with naming(stream):
            result = self.decoded(read_coded(stream, self.rate))
        about = {"source": stream.name, "codec": result.record["codec"]}
        decoded = replace(result.cloud, about=about)
        if original is not None:
            _check_place(decoded, original, f"{stream}: not coded from {like}")
            decoded = replace(decoded, xyz=original.to_metres(decoded.xyz))
        write_cloud(cloud, decoded)
        return result.record

    def _mesh(self, path: Path, out: Path) -> dict[str, Any]:
        name, coded = self.read_stream(path, self.rate)
        with naming(path):
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
    """Raise InputError if decoded points lie far outside the box of the original ones."""
    low, high = bounds(original.xyz)
    margin = (high - low).max()
    if (decoded.xyz < low - margin).any() or (decoded.xyz > high + margin).any():
        raise InputError(f"{fault}: the decoded points lie elsewhere")


def _described(path: Path) -> PointCloud:
    cloud = read_cloud(path)
    if cloud.frame is None:
        needed = "no description (.json) with scale and offset is beside it"
        raise InputError(f"{path}: {needed}; name the prepared cloud, as in results/clouds/")
    return cloud


@JOBS.register("decode_shown")
class DecodeShown(Decoding):
    """Decode the rates of a curve that the report shows."""

    rates: tuple[str, ...]

    def run(self, curve: Path, clouds: Path) -> dict[str, Any]:
        coded = read_curve(curve)
        members = {}
        with naming(curve):
            for rate in self.rates:
                cloud = self.decoded(coded[rate]).cloud
                members[f"{rate}.ply"] = cloud_bytes(cloud)
        write_archive(clouds, members)
        return {"clouds": len(members)}

"""Decoding a stream: points, or the surface that a codec of surfaces has coded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from puckbench.codecs.measurement import measured
from puckbench.core.environment import run_environment
from puckbench.core.errors import naming
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.io.meshes.writing import write_mesh
from puckbench.jobs.codecs import TimedJob
from puckbench.jobs.registry import JOBS


class Decoded(NamedTuple):
    """A decoded cloud, and what decoding cost."""

    cloud: PointCloud
    record: dict[str, Any]


class Decoding(TimedJob):
    """A job that decodes streams; the codec is found from the stream where none is named."""

    def decoded(self, path: Path) -> Decoded:
        """Decode a stream file, timed; InputError names the file when it is damaged or foreign."""
        name, stream = self.read_stream(path)
        with naming(path):
            codec = self.loaded(name)
            timed = measured(lambda: codec.decode_cloud(stream), self.repeats, codec.cost)
        record = {
            "codec": name,
            "bytes": len(stream),
            "points_out": len(timed.result),
            **timed.costs("decode"),
            **run_environment(self.alone),
        }
        return Decoded(timed.result, record)

    def write_decoded(self, stream: Path, cloud: Path) -> dict[str, Any]:
        """Write the decoded cloud of a stream file as PLY."""
        decoded, record = self.decoded(stream)
        about = {"source": stream.name, "codec": record["codec"]}
        write_cloud(cloud, replace(decoded, about=about))
        return record


@JOBS.register("decode")
class Decode(Decoding):
    """Decode a stream to a cloud, or to the mesh of its surface."""

    as_mesh: bool = False

    def run(self, stream: Path, cloud: Path) -> dict[str, Any]:
        """Write the decoded cloud or mesh as PLY."""
        return self._mesh(stream, cloud) if self.as_mesh else self.write_decoded(stream, cloud)

    def _mesh(self, path: Path, out: Path) -> dict[str, Any]:
        name, stream = self.read_stream(path)
        with naming(path):
            mesh = self.loaded(name).decode_mesh(stream)
        write_mesh(out, mesh, {"source": path.name, "codec": name})
        return {
            "codec": name,
            "bytes": len(stream),
            "vertices": len(mesh.vertices),
            "triangles": len(mesh.triangles),
            "primitives": len(mesh.labels.primitives) if mesh.labels else 0,
        }


@JOBS.register("decode_curve")
class DecodeCurve(Decoding):
    """Decode streams of a rate-distortion curve to clouds, in one process."""

    def run(self, streams: tuple[Path, ...], clouds: tuple[Path, ...]) -> dict[str, Any]:
        """Write the decoded clouds as PLY."""
        for stream, cloud in zip(streams, clouds, strict=True):
            self.write_decoded(stream, cloud)
        return {"clouds": len(clouds)}

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

    def write_decoded(self, found: Decoded, stream: Path, cloud: Path) -> None:
        """Write the decoded cloud of a stream file as PLY."""
        about = {"source": stream.name, "codec": found.record["codec"]}
        write_cloud(cloud, replace(found.cloud, about=about))


@JOBS.register("decode")
class Decode(Decoding):
    """Decode a stream to a cloud, or to the mesh of its surface."""

    as_mesh: bool = False

    def run(self, stream: Path, cloud: Path) -> dict[str, Any]:
        """Write the decoded cloud or mesh as PLY."""
        if self.as_mesh:
            return self._mesh(stream, cloud)
        found = self.decoded(stream)
        self.write_decoded(found, stream, cloud)
        return found.record

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

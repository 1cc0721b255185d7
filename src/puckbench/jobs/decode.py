"""Decoding a stream: points, or the surface that a codec of surfaces has coded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from puckbench.codecs.measurement import measured
from puckbench.core.environment import run_environment
from puckbench.core.errors import naming
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.io.clouds import write_cloud
from puckbench.io.meshes.writing import write_mesh
from puckbench.jobs.codecs import TimedJob
from puckbench.jobs.registry import JOBS

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


class Decoded(NamedTuple):
    """Decoded points (m, 3), what decoding cost, and the returns where the codec codes them."""

    points: Floats
    record: dict[str, Any]
    returns: Returns | None = None


class Decoding(TimedJob):
    """A job that decodes streams; the codec is found from the stream where none is named."""

    def decoded(self, path: Path) -> Decoded:
        """Decode a stream file, timed; InputError names the file when it is damaged or foreign."""
        name, stream = self.read_stream(path)
        with naming(path):
            codec = self.loaded(name)
            if codec.takes == "returns":
                timed = measured(lambda: codec.decode_returns(stream), self.repeats, codec.cost)
                returns, points = timed.result, timed.result.points()
            else:
                timed = measured(lambda: codec.decode(stream), self.repeats, codec.cost)
                returns, points = None, timed.result
        record = {
            "codec": name,
            "bytes": len(stream),
            "points_out": len(points),
            **timed.costs("decode"),
            **run_environment(self.alone),
        }
        return Decoded(points, record, returns)

    def write_decoded(self, stream: Path, cloud: Path) -> dict[str, Any]:
        """Write the decoded cloud of a stream file as PLY."""
        points, record, _ = self.decoded(stream)
        about = {"source": stream.name, "codec": record["codec"]}
        write_cloud(cloud, PointCloud(points, about=about))
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

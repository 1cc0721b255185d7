"""Coding a cloud with a codec at a rate, and what it cost."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from puckbench.codecs.base import Codec
from puckbench.codecs.measurement import measured
from puckbench.codecs.registry import open_codec
from puckbench.core.environment import cpu_model, run_environment
from puckbench.core.errors import naming
from puckbench.core.files import write_json, written_whole
from puckbench.geometry.cloud import PointCloud
from puckbench.io.clouds import read_cloud
from puckbench.jobs.codecs import TimedJob, ready, record_file
from puckbench.jobs.prepare import Prepare
from puckbench.jobs.registry import JOBS


@JOBS.register("encode")
class Encode(TimedJob):
    """Code a cloud at a rate; the record of it goes beside the stream.

    frame: of a cloud whose description does not tell.
    """

    codec: str
    rate: str
    frame: Literal["scaled"] | None = None

    def run(self, cloud: Path, stream: Path, prepared: Path | None = None) -> dict[str, Any]:
        """Write the stream and its record.

        Parameters
        ----------
        cloud
            The cloud to code.
        prepared
            Where to write the cloud prepared, which is then coded in its stead.
        """
        codec = open_codec(self.codec, self.changes)
        codec.parameters_of(self.rate)
        points = self._cloud(codec, cloud, prepared).xyz
        ready(codec)
        coded = measured(lambda: codec.encode(points, self.rate), self.repeats, codec.cost)
        weights = codec.weights_of(self.rate)
        record = {
            "codec": self.codec,
            "rate": self.rate,
            "codec_version": codec.version,
            **({"weights": weights} if weights else {}),
            "points_in": len(points),
            "bytes": len(coded.result),
            "bpp": 8 * len(coded.result) / len(points),
            "repeats": self.repeats,
            **coded.costs("encode"),
            **run_environment(self.alone),
            "encode_cpu": cpu_model(),  # decoding may be done, and recorded, elsewhere
        }
        with written_whole(stream) as temporary:
            temporary.write_bytes(coded.result)
            write_json(record_file(stream), record)
        return record

    def _cloud(self, codec: Codec, path: Path, prepared: Path | None) -> PointCloud:
        """The cloud to code; InputError where the codec's rates are not in its frame."""
        if prepared:
            Prepare().run(path, prepared)
        cloud = read_cloud(prepared or path)
        with naming(path):
            codec.check_frame(self.frame or cloud.frame)
        return cloud

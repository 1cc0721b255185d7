"""Coding a cloud with a codec at a rate, and what it cost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from puckbench.codecs.measurement import measured
from puckbench.core.environment import cpu_model, run_environment
from puckbench.core.files import write_json, written_whole
from puckbench.io.clouds import read_cloud
from puckbench.jobs.codecs import TimedJob, record_file
from puckbench.jobs.registry import JOBS


@JOBS.register("encode")
class Encode(TimedJob):
    """Code a cloud at a rate; the record of it goes beside the stream."""

    codec: str
    rate: str

    def run(self, cloud: Path, stream: Path) -> dict[str, Any]:
        """Write the stream and its record."""
        codec = self.loaded(self.codec)
        points = read_cloud(cloud).xyz
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

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from pointkit.errors import naming
from pointkit.files import write_json, written_whole
from pointkit.geometry.cloud import CoordinateFrame, PointCloud
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import check_codes
from puckbench.codecs.rates import is_length, rate_name
from puckbench.codecs.registry import open_codec
from puckbench.geometry.attributes import RETURNS
from puckbench.jobs.codec_jobs import ready
from puckbench.jobs.curve_files import record_file
from puckbench.jobs.encode_curve import Encoding, to_code
from puckbench.jobs.prepare import Prepare
from puckbench.jobs.registry import JOBS


@JOBS.register("encode")
class Encode(Encoding):
    """Encode a cloud at one rate.

    Parameters
    ----------
    rate
        Name of the rate.
    frame
        Coordinate frame of the cloud, ``metric`` or ``scaled``. By default, the cloud's description
        or file format tells it.
    """

    rate: str
    frame: CoordinateFrame | None = None

    def run(self, cloud: Path, stream: Path, prepared: Path | None = None) -> dict[str, Any]:
        """Write the stream, with its record (JSON) beside it, and return the record.

        If `prepared` is set, the cloud is first prepared for coding (scaled, with normals), and
        this prepared cloud is written to the file `prepared` and encoded.
        """
        codec = open_codec(self.codec, self.changes)
        with naming("--rate"):
            rate = rate_name(codec, self.rate)
        original = self._cloud(codec, cloud, rate, prepared)
        if RETURNS in codec.attributes and original.returns is None:
            why = f"no returns, so codec {self.codec} does without its sensor"
            sys.stderr.write(f"puckbench: {prepared or cloud}: {why}\n")
        coded = self.coded(ready(codec), original, rate)
        with written_whole(stream) as temporary:
            temporary.write_bytes(coded.stream)
            write_json(record_file(stream), coded.record)
        return coded.record

    def _cloud(self, codec: Codec, path: Path, rate: str, prepared: Path | None) -> PointCloud:
        if prepared:
            frame = self.frame or ("metric" if is_length(codec, rate) else "scaled")
            check_codes(codec, CloudKind(frame, True, True), rate)
            job = Prepare(size=0) if frame == "metric" else Prepare()
            job.run(path, prepared)
        return to_code(codec, prepared or path, self.frame, rate)

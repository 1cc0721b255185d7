from __future__ import annotations

from pathlib import Path
from typing import Any

from cloud_files.clouds import cloud_bytes
from pointkit.errors import naming
from puckbench.core.archives import write_archive
from puckbench.core.code import CLOUD_FILES, CODEC
from puckbench.jobs.curve_files import read_curve
from puckbench.jobs.decoding import Decoding
from puckbench.jobs.registry import JOBS

CODE = (*CLOUD_FILES, *CODEC, "puckbench.jobs.decoding")


@JOBS.register("decode_shown")
class DecodeShown(Decoding):
    """Decode a cloud at the rates that the report shows.

    `rates` are the names of these rates.
    """

    rates: tuple[str, ...]

    def run(self, curve: Path, clouds: Path) -> dict[str, Any]:
        """Write the decoded clouds to one ZIP file, as ``RATE.ply``, and return their number."""
        coded = read_curve(curve)
        members = {}
        with naming(curve):
            for rate in self.rates:
                cloud = self.decoded(coded[rate]).cloud
                members[f"{rate}.ply"] = cloud_bytes(cloud)
        write_archive(clouds, members)
        return {"clouds": len(members)}

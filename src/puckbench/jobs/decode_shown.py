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

"""A stand-in for MPEG's program ``tmc3``, which cannot be installed: it codes with our own coder.

It takes the options that scripts in benchmarks/ pass, so that a test can start these scripts. What
it makes of them is no evidence of anything.
"""

import sys
from typing import Any

import numpy as np

from cloud_files.clouds import read_cloud
from gpcc.coder import decode_geometry, encode_geometry
from gpcc.options import PROFILES
from gpcc.predictive_coder import PredictiveOptions, encode_predictive_geometry
from pointkit.files import read_bytes
from puckbench.codecs.external import write_points


def main(options: dict[str, Any]) -> None:
    from pathlib import Path

    stream = Path(options["compressedStreamPath"])
    if options["mode"] == "1":
        points = decode_geometry(read_bytes(stream)).positions()
        write_points(Path(options["reconstructedDataPath"]), points, "float64")
    else:
        scale = float(options.get("positionQuantizationScale", 1))
        points = np.floor(read_cloud(Path(options["uncompressedDataPath"])).xyz * scale)
        stream.write_bytes(_encoded(points.astype(np.int64), options, scale))
    sys.stdout.write("Processing time (wall): 0.01 s\nProcessing time (user): 0.01 s\n")


def _encoded(points: Any, options: dict[str, Any], scale: float) -> bytes:
    merges = options.get("mergeDuplicatedPoints", "0") == "1"
    scale *= 1 / float(options.get("externalScale", 1)) if scale == 1 else 1
    if options.get("geomTreeType") == "1":
        tools = PredictiveOptions(order="given", merge_duplicates=merges)
        return encode_predictive_geometry(points, tools, None, scale)
    tools = PROFILES["minimal"].model_copy(update={"merge_duplicates": merges})
    least = points.min(axis=0)
    return encode_geometry(points - least, tools, scale, least)


if __name__ == "__main__":
    main(dict(word.removeprefix("--").split("=", 1) for word in sys.argv[1:]))

"""Rate and distortion of sets of weights beside each other, with BD-rates against the first.

    python benchmarks/weights_compared.py cloud.ply [more.ply ...] --codecs 'YAML'

YAML: names and entries as under `codecs` of a configuration; the first is the anchor:

    {gpcc: {}, pcgcv2: {}, theirs: {class: "puckbench.codecs.pcgcv2.codec:Pcgcv2",
     options: {weights: DIR}, rates: {r1: {alpha: 0.25}, r2: {alpha: 0.5}, r3: {alpha: 1}}}}

Clouds are prepared ones, on the 1,024 grid. Every byte counts; D1 is the larger direction's mean
squared distance, as MPEG's PSNR with peak 1023. Seconds are the processor's own.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from puckbench.analysis.bd_tables import bd_rate_clouds
from puckbench.cloud import PointCloud, read_cloud
from puckbench.codecs.codec import Codec
from puckbench.codecs.registry import open_codec
from puckbench.metrics.geometry import distortion

PEAK_SQUARED = 3 * 1023.0**2


def measured(codec: Codec, path: Path, rate: str) -> dict[str, object]:
    """A row of the table."""
    cloud = PointCloud(read_cloud(path).xyz)
    start = time.process_time()
    stream = codec.encode(cloud.xyz, rate)
    between = time.process_time()
    decoded = codec.decode(stream)
    end = time.process_time()
    found = distortion(cloud, decoded)
    return {
        "dataset": path.parent.name, "cloud": path.stem, "codec": codec.name, "rate": rate,
        "bpp": 8 * len(stream) / len(cloud), "d1_mse": found["d1_mse"],
        "d1": 10 * np.log10(PEAK_SQUARED / found["d1_mse"]),
        "cd": found["cd_point"], "encode_s": between - start, "decode_s": end - between,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clouds", type=Path, nargs="+")
    parser.add_argument("--codecs", required=True, type=yaml.safe_load)
    options = parser.parse_args()
    rows = []
    for name, entry in options.codecs.items():
        codec = open_codec(name, entry)
        codec.load()
        for path in options.clouds:
            for rate in codec.rates:
                rows.append(measured(codec, path, rate))
                print(*(f"{v:.4f}" if isinstance(v, float) else v for v in rows[-1].values()))
    table = pd.DataFrame(rows)
    deltas = bd_rate_clouds(table, next(iter(options.codecs)), ["d1_mse"])
    print(deltas.drop(columns=["log_ratio"]).to_string())
    print(deltas.groupby(["codec", "dataset"])["bd_rate_percent"].mean())


if __name__ == "__main__":
    main()

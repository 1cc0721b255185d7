"""Rate and distortion of sets of weights beside each other, with BD-rates against the first.

    python -m benchmarks.ablations.weights_compared cloud.ply [more.ply ...] --codecs 'YAML'

YAML: names and entries as under `codecs` of a configuration; the first is the anchor:

    {gpcc: {}, pcgcv2_plus: {}, pcgcv2: {}}

Clouds are prepared ones, on the 1,024 grid. Every byte counts; D1 is MPEG's PSNR of the larger
direction's mean squared distance with peak 1023.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd
import yaml

from puckbench.jobs.library import PointCloud, compare, open_codec, read_cloud
from puckbench.metrics.tables.rate_deltas import bd_rate_clouds

_SHOWN = ["dataset", "cloud", "codec", "rate", "bpp", "d1_psnr", "encode_s", "decode_s"]
_DELTAS = ["dataset", "cloud", "codec", "bd_rate_percent", "bd_rate_status", "shared_range"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clouds", type=Path, nargs="+")
    parser.add_argument("--codecs", required=True, type=yaml.safe_load)
    options = parser.parse_args()
    codecs = [open_codec(name, entry) for name, entry in options.codecs.items()]
    rows = []
    for path in options.clouds:
        found = compare(PointCloud(read_cloud(path).xyz), codecs)
        rows.append(found.assign(dataset=path.parent.name, cloud=path.stem))
        print(rows[-1][_SHOWN].to_string(index=False, float_format="%.4f"), flush=True)
    deltas = bd_rate_clouds(pd.concat(rows), codecs[0].name, ["d1_psnr"])[_DELTAS]
    print(deltas.to_string(index=False, float_format="%.2f"))
    print(deltas.groupby(["codec", "dataset"])["bd_rate_percent"].agg(["mean", "count"]))


if __name__ == "__main__":
    main()

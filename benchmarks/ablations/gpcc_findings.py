"""Rate and distortion of G-PCC by rounding, by scales that are no power of two, and by its tools.

    python -m benchmarks.ablations.gpcc_findings [--step 0.1]

For a generated office scanned without and with errors (azimuth step in degrees; 0.1 are the
thesis's 1,152,000 rays) and for an object, at PCC Arena's scales and beyond: Chamfer distances to
the coded cloud with both roundings, and bytes of the three profiles.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from benchmarks.clouds import sampled_object, scanned_room

from puckbench.codecs.registry import open_codec
from puckbench.geometry.cloud import Floats, PointCloud
from puckbench.geometry.normals import estimate_normals
from puckbench.metrics.geometry import distortion

SCALES = [0.0625, *(eighths / 8 for eighths in range(1, 9)), 2.0, 4.0]
RATES = {f"s{number}": {"scale": scale} for number, scale in enumerate(SCALES)}
COLUMNS = (
    *("cloud", "scale", "bpp", "CD(point), nearest", "truncate", "CD(plane), nearest", "truncate"),
    *("bytes, ctc", "minimal", "defaults"),
)


def clouds(step: float) -> Iterator[tuple[str, Floats]]:
    yield "noisy room", scanned_room("vlp16_divergence", step)
    yield "clean room", scanned_room("none", step)
    yield "object", sampled_object(500_000)


def coded(points: Floats, rate: str, **options: str) -> tuple[int, Floats]:
    """Bytes and decoded points."""
    codec = open_codec("gpcc", {"rates": RATES, "options": options})
    stream = codec.encode(points, rate)
    return len(stream), codec.decode(stream)


def row(name: str, cloud: PointCloud, rate: str) -> str:
    bytes_, nearest = coded(cloud.xyz, rate, profile="ctc", rounding="nearest")
    _, truncated = coded(cloud.xyz, rate, profile="ctc", rounding="truncate")
    others = [coded(cloud.xyz, rate, profile=other)[0] for other in ("minimal", "defaults")]
    found = [distortion(cloud, decoded) for decoded in (nearest, truncated)]
    cells = [
        *(name, f"{RATES[rate]['scale']:g}", f"{8 * bytes_ / len(cloud):.3f}"),
        *(f"{of[kind]:.3g}" for kind in ("cd_point", "cd_plane") for of in found),
        *(f"{bytes_:,}", *(f"{other / bytes_ - 1:+.1%}" for other in others)),
    ]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--step", type=float, default=0.1)
    options = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    for name, points in clouds(options.step):
        cloud = PointCloud(points, estimate_normals(points))
        for rate in RATES:
            print(row(name, cloud, rate), flush=True)


if __name__ == "__main__":
    main()

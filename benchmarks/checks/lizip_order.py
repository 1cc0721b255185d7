"""What LiZIP saves by its network, and what by giving up the order of the points.

    python -m benchmarks.checks.lizip_order WEIGHTS FRAME... [--program PROGRAM]

WEIGHTS is `mlp_c3_h256.bin` of LiZIP's authors. A FRAME has five numbers of single precision a
point, as those in their `tests/fixtures`. Sizes are in KB of 1024 bytes, of coordinates in steps of
0.01 mm: LiZIP without puckbench's header; LAZ in the order of the file and in LiZIP's order; and
differences to the point before in LiZIP's order, with LiZIP's own bytes and compressor (LZMA).
PROGRAM is the authors', compiled by the command in their workflow: its files are compared with
ours byte by byte, and the points that both decode.
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.claims.order import differences

from pcc_networks import lizip
from pcc_networks.lizip.stream import authors_file
from pcc_networks.lizip.weights import LizipWeights
from pointkit.geometry.cloud import Floats
from puckbench.codecs.storage.laz import encode_laz

STEP_M = 0.00001
FLOATS_PER_POINT = 5


def sizes(points: Floats, weights: LizipWeights) -> Iterator[tuple[str, int]]:
    """Yield names and sizes, bytes, of a frame's points (n, 3) by each method."""
    for compression in ("lzma", "zlib"):
        stream = lizip.encode(points, weights, STEP_M, compression)
        yield f"LiZIP ({compression})", len(authors_file(lizip.read_stream(stream)))
    yield "LAZ, file's order", len(encode_laz(points, STEP_M))
    sorted_points = lizip.decode(stream, weights)
    yield "LAZ, LiZIP's order", len(encode_laz(sorted_points, STEP_M))
    yield "differences, LiZIP's order", len(differences(sorted_points, STEP_M))


def beside(program: Path, frame: Path, weights_file: Path, weights: LizipWeights) -> str:
    """Return whether the authors' program writes the same file and decodes the same points."""
    stream = lizip.encode(points_of(frame), weights, STEP_M)
    decoded = lizip.decode(stream, weights).astype("<f4")
    with TemporaryDirectory() as folder:
        file, points = Path(folder, "file"), Path(folder, "points")
        for words in (("e", frame, file), ("d", file, points)):
            subprocess.run([program, *words, weights_file], check=True, capture_output=True)
        is_same = file.read_bytes() == authors_file(lizip.read_stream(stream))
        return f"same file {is_same}, same points {points.read_bytes() == decoded.tobytes()}"


def points_of(frame: Path) -> Floats:
    """Read the coordinates (n, 3) of a frame."""
    return np.fromfile(frame, "<f4").reshape(-1, FLOATS_PER_POINT)[:, :3].astype(np.float64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument("frames", type=Path, nargs="+")
    parser.add_argument("--program", type=Path)
    options = parser.parse_args()
    weights = lizip.load_weights(options.weights)
    rows = []
    for frame in options.frames:
        points = points_of(frame)
        row = dict(sizes(points, weights))
        rows.append(row)
        numbers = ", ".join(f"{name} {size / 1024:.1f}" for name, size in row.items())
        print(f"{frame.name} ({len(points)} points): {numbers}", flush=True)
        if options.program:
            print(
                f"  equal: {beside(options.program, frame, options.weights, weights)}", flush=True
            )
    for name in rows[0]:
        values = np.array([row[name] for row in rows]) / 1024
        spread = values.std(ddof=1) if len(values) > 1 else 0.0
        print(f"mean of {len(values)}: {name}: {values.mean():.2f} KB, std {spread:.2f}")


if __name__ == "__main__":
    main()

"""Conformance vectors for G-PCC: streams that the reference software made of generated scenes.

    python -m benchmarks.checks.gpcc_vectors TMC3 [FOLDER]

TMC3 is the reference encoder, release-v14.0. For each row of `VECTORS`, writes NAME.bin, and
into manifest.json the options, the point counts and the SHA-256 of what TMC3 decodes from it: the
points as little-endian float64, sorted by x, then y, then z.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.clouds import grown, sampled_object, scanned_room
from tests.gpcc.geometry_vectors import VECTORS
from tests.support.small_turn import small_turn

from gpcc.conformance import FOLDER, digest
from pointkit.files import write_json
from pointkit.geometry.cloud import Floats
from puckbench.cli.decoding_program import program_decoder
from puckbench.codecs.external import write_points
from puckbench.codecs.tmc13 import PROFILES


@cache
def cloud(name: str) -> Floats:
    line = np.arange(40.0)[:, None]
    shapes: dict[str, Callable[[], Floats]] = {
        "turn": small_turn,
        "pairs": lambda: np.repeat(small_turn(), 2, axis=0),
        "flat": lambda: np.floor(sampled_object(3000)) * [1, 1, 0] + [0, 0, 7],
        "line": lambda: line * [7, 0, 0] + [3, 5, 9],
        "few": lambda: np.floor(sampled_object(300)),
        "one": lambda: np.array([[5.0, 6.0, 7.0]]),
        "two": lambda: np.array([[0.0, 0.0, 0.0], [1000.0, 1.0, 2.0]]),
        "same": lambda: np.repeat([[5.0, 6.0, 7.0], [5.0, 6.0, 9.0]], [20, 3], axis=0),
        "full": lambda: np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3),
        "clean": lambda: scanned_room("none", 2.0)[::8],
        "noisy": lambda: scanned_room("vlp16_divergence", 2.0)[::8],
        "object": lambda: sampled_object(6000),
        "away": lambda: np.floor(sampled_object(3000)) - [900, 50, 123456],
        "deep16": lambda: grown(cloud("noisy")[::2], 16),
        "deep18": lambda: grown(cloud("noisy")[::3], 18),
        "deep21": lambda: grown(cloud("noisy")[::3], 21),
    }
    return shapes[name]()


def made(tmc3: str, folder: Path, name: str) -> dict[str, Any]:
    source, profile, scale, more = VECTORS[name]
    points, stream = cloud(source), folder / f"{name}.bin"
    options = [*PROFILES[profile], *more]
    with tempfile.TemporaryDirectory() as at:
        write_points(Path(at) / "in.ply", points, "float64")
        run = [tmc3, "--mode=0", "--disableAttributeCoding=1", *options]
        run += [f"--positionQuantizationScale={scale!r}", f"--compressedStreamPath={stream}"]
        silent(*run, f"--uncompressedDataPath={at}/in.ply")
    decoded = program_decoder(tmc3)(stream.read_bytes())[:, :3]
    return {
        "profile": profile,
        "scale": scale,
        "options": options,
        "points_in": len(points),
        "points_out": len(decoded),
        "bytes": stream.stat().st_size,
        "sha256_sorted_float64": digest(decoded),
    }


def silent(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


def make_vectors(
    description: str | None,
    names: Iterable[str],
    folder: Path,
    make: Callable[[str, Path, str], dict[str, Any]],
) -> None:
    """Make the streams that the command line selects, by `make`, and the manifest."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("tmc3")
    parser.add_argument("folder", type=Path, nargs="?", default=folder)
    parser.add_argument("--only", nargs="+", choices=list(names), default=list(names))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    lines = {name: make(options.tmc3, options.folder, name) for name in options.only}
    write_json(options.folder / "manifest.json", lines)
    print(f"{len(lines)} streams, {sum(line['bytes'] for line in lines.values()):,} bytes")


if __name__ == "__main__":
    make_vectors(__doc__, VECTORS, FOLDER, made)

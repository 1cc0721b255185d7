"""Conformance vectors for G-PCC attributes: streams that the reference software made.

    python -m benchmarks.checks.gpcc_attribute_vectors TMC3 [FOLDER]

TMC3 is the reference encoder, release-v14.0. For each row of `VECTORS`, writes NAME.bin, and
into manifest.json the options and the SHA-256 of the rows that TMC3 decodes: x, y, z and the
attributes as little-endian float64, sorted and in decoded order.
"""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.checks.gpcc_vectors import make_vectors, silent
from numpy.typing import NDArray
from tests.gpcc.attribute_vectors import FOLDER, GEOMETRIES, VECTORS, colours, points, reflectances

from gpcc.conformance import digest
from puckbench.cli.decoding_program import program_decoder

Rows = NDArray[np.int64]


def write_ply(path: Path, columns: dict[str, Rows]) -> None:
    kinds = {"x": "float", "y": "float", "z": "float", "reflectance": "uint16"}
    header = [f"property {kinds.get(name, 'uchar')} {name}" for name in columns]
    rows = np.column_stack(list(columns.values()))
    lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *header, "end_header"]
    path.write_text("\n".join([*lines, *(" ".join(map(str, row)) for row in rows.tolist()), ""]))


def made(tmc3: str, folder: Path, name: str) -> dict[str, Any]:
    geometry, attributes = VECTORS[name]
    cloud = points()
    columns = dict(zip("xyz", cloud.T, strict=True))
    if "--attribute=color" in attributes:
        columns |= dict(zip(("red", "green", "blue"), colours(cloud).T, strict=True))
    if "--attribute=reflectance" in attributes:
        columns["reflectance"] = reflectances(cloud)
    options = [*GEOMETRIES[geometry], *attributes]
    stream = folder / f"{name}.bin"
    with tempfile.TemporaryDirectory() as at:
        write_ply(Path(at) / "in.ply", columns)
        run = [tmc3, "--mode=0", f"--uncompressedDataPath={at}/in.ply", *options]
        silent(*run, f"--compressedStreamPath={stream}")
    decoded = program_decoder(tmc3)(stream.read_bytes())
    return {
        "options": options,
        "bytes": stream.stat().st_size,
        "points_out": len(decoded),
        "sha256_sorted_float64": digest(decoded),
        "sha256_float64": hashlib.sha256(decoded.astype("<f8").tobytes()).hexdigest(),
    }


if __name__ == "__main__":
    make_vectors(__doc__, VECTORS, FOLDER, made)

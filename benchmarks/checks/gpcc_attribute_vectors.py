"""Conformance vectors for G-PCC attributes: streams that the reference software made.

    python -m benchmarks.checks.gpcc_attribute_vectors TMC3 [FOLDER]

TMC3 is the reference encoder, release-v14.0. For each row of the table below, writes NAME.bin, and
into manifest.json the options and the SHA-256 of the rows that TMC3 decodes: x, y, z and the
attributes as little-endian float64, in decoded order.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.gpcc.attribute_vectors import FOLDER, GEOMETRIES, VECTORS, colours, points, reflectances

from puckbench.core.files import write_json

Rows = NDArray[np.int64]


def write_ply(path: Path, columns: dict[str, Rows]) -> None:
    kinds = {"x": "float", "y": "float", "z": "float", "reflectance": "uint16"}
    header = [f"property {kinds.get(name, 'uchar')} {name}" for name in columns]
    rows = np.column_stack(list(columns.values()))
    lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *header, "end_header"]
    path.write_text("\n".join([*lines, *(" ".join(map(str, row)) for row in rows.tolist()), ""]))


def read_ply(path: Path) -> NDArray[np.float64]:
    """Return x, y, z, then red, green, blue and the reflectance if there are any."""
    header, body = path.read_text().split("end_header\n")
    properties = [line.split() for line in header.splitlines() if line.startswith("property")]
    names = [words[-1] for words in properties if words[1] != "list"]
    rows = np.array(body.split(), dtype=float).reshape(-1, len(names))
    wanted = ["x", "y", "z", "red", "green", "blue", "refc"]
    return rows[:, [names.index(name) for name in wanted if name in names]]


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
        command([*run, "--convertPlyColourspace=1", f"--compressedStreamPath={stream}"])
        run = [tmc3, "--mode=1", "--outputBinaryPly=0", "--convertPlyColourspace=1"]
        command([*run, f"--compressedStreamPath={stream}", f"--reconstructedDataPath={at}/o.ply"])
        decoded = read_ply(Path(at) / "o.ply")
    digest = hashlib.sha256(decoded.astype("<f8").tobytes()).hexdigest()
    return {"options": options, "bytes": stream.stat().st_size, "sha256_float64": digest}


def command(words: list[str]) -> None:
    subprocess.run(words, check=True, capture_output=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tmc3")
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    lines = {name: made(options.tmc3, options.folder, name) for name in VECTORS}
    write_json(options.folder / "manifest.json", lines)
    print(f"{len(lines)} streams, {sum(line['bytes'] for line in lines.values()):,} bytes")


if __name__ == "__main__":
    main()

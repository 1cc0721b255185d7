"""Formats that keep the order of points, in several orders of the same points.

    python -m benchmarks.claims.order [FRAME ...] [--scenes 8] [--step-mm 1]

LAZ, Cloudini and Draco's sequential method code each generated turn (streets, a virtual HDL-64E)
and each FRAME (KITTI's or nuScenes's .bin with --columns, or any cloud) in the order in which it
was acquired, by laser, along a Morton curve, sorted by x, y and z, by voxels of 0.1 m as LiZIP
sorts them, and at random. LAZ also with the time and the laser of each point, without which a
spatial order loses what the acquired order tells. Then Draco in the settings of Cloudini's own
benchmarks, and processor time of encoding. Printed are bits per point, and ratios with verdicts.
"""

from __future__ import annotations

import argparse
import lzma
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from benchmarks.claims.scenes import report, scanned, street_names
from benchmarks.performance.rows import least_seconds
from numpy.typing import NDArray

from cloud_files.clouds import read_cloud
from cloud_files.las import las_bytes, las_points
from pointkit.geometry.cloud import Floats
from pointkit.geometry.morton import morton_codes
from puckbench.codecs.storage.steps import in_steps

VOXEL_M = 0.1
DRACO_BITS = {"pcd_benchmark": (14, 0.001), "rosbag_benchmark": (16, 0.0001)}
"""Bits of Draco's positions, and Cloudini's resolution in m, in Cloudini's two benchmarks."""
DRACO_DEFAULT_LEVEL = 5
"""10 less the default speed of Draco's encoder."""
REPEATS = 5

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Frame:
    """Points (n, 3) in m as acquired; lasers (n,) and times (n,) in s of virtual turns."""

    name: str
    xyz: Floats
    lasers: NDArray[np.uint8] | None = None
    times: Floats | None = None


def orders(frame: Frame, step: float) -> Mapping[str, Rows]:
    """Return the rows of a frame in each order."""
    steps = in_steps(frame.xyz, step)
    whole = steps - steps.min(axis=0)
    voxels = np.floor(frame.xyz / VOXEL_M)
    found = {"acquired": np.arange(len(steps))}
    if frame.lasers is not None:
        found["by laser"] = np.argsort(frame.lasers, kind="stable")
    return {
        **found,
        "Morton": np.argsort(morton_codes(whole, np.arange(3)), kind="stable"),
        "x, y, z": np.lexsort(steps.T[::-1]),
        "voxels": np.lexsort(voxels.T),
        "random": np.random.default_rng(1).permutation(len(steps)),
    }


def laz(frame: Frame, rows: Rows, step: float, is_timed: bool) -> bytes:
    """Return LAZ of a frame's rows; with the time and the laser of each point if `is_timed`."""
    las = las_points(in_steps(frame.xyz[rows], step), step, np.zeros(3), 1 if is_timed else 0)
    if is_timed:
        assert frame.times is not None
        assert frame.lasers is not None
        las.gps_time, las.user_data = np.rint(frame.times[rows] * 1e6), frame.lasers[rows]
    return las_bytes(las, is_compressed=True)


def cloudini(points: Floats, step: float) -> bytes:
    """Return single-precision points in Cloudini's lossy format with Zstandard, its default."""
    import pureini

    fields = [
        pureini.PointField(axis, 4 * place, pureini.FieldType.FLOAT32, step)
        for place, axis in enumerate("xyz")
    ]
    info = pureini.EncodingInfo(
        fields,
        width=len(points),
        point_step=12,
        encoding_opt=pureini.EncodingOptions.LOSSY,
        compression_opt=pureini.CompressionOption.ZSTD,
    )
    return bytes(pureini.PointcloudEncoder(info).encode(points.astype("<f4").tobytes()))


def draco(points: Floats, bits: int | None = None, step: float | None = None) -> bytes:
    """Return points by Draco's sequential method, with bits of the bounding cube or a step."""
    import DracoPy

    options: dict[str, Any] = {"quantization_bits": bits}
    if step is not None:
        low = np.floor(points.min(axis=0) / step) * step
        bits = int(np.ceil(np.log2((points - low).max() / step + 2)))
        width = step * (2**bits - 1)
        origin = low.tolist()
        options = {
            "quantization_bits": bits, "quantization_range": width, "quantization_origin": origin
        }  # fmt: skip
    options |= {"compression_level": DRACO_DEFAULT_LEVEL, "preserve_order": True}
    return bytes(DracoPy.encode(points.astype("<f4"), **options))


def differences(points: Floats, step: float) -> bytes:
    """Return differences of successive points, their bytes apart from each other, by LZMA."""
    steps = in_steps(points, step).astype("<i4")
    planes = np.diff(steps, axis=0, prepend=0).astype("<i4").reshape(-1, 1).view(np.uint8)
    return lzma.compress(planes.T.tobytes(), preset=9)


def measured(frame: Frame, step: float) -> dict[str, float]:
    """Return bits per point by format and order, and seconds."""
    bits: dict[str, float] = {}

    def note(name: str, stream: bytes) -> None:
        bits[name] = 8 * len(stream) / len(frame.xyz)

    for order, rows in orders(frame, step).items():
        points = frame.xyz[rows]
        note(f"LAZ, {order}", laz(frame, rows, step, False))
        if frame.times is not None:
            note(f"LAZ with time and laser, {order}", laz(frame, rows, step, True))
        note(f"Cloudini, {order}", cloudini(points, step))
        note(f"Draco, {order}", draco(points, step=step))
        note(f"differences and LZMA, {order}", differences(points, step))
    for name, (width, resolution) in DRACO_BITS.items():
        note(f"Draco as in {name}", draco(frame.xyz, width))
        note(f"Cloudini as in {name}", cloudini(frame.xyz, resolution))
        side = float(np.ptp(frame.xyz, axis=0).max())
        bits[f"Draco as in {name}: step, mm"] = 1000 * side / (2**width - 1)
    bits["Cloudini: seconds"] = least_seconds(lambda: cloudini(frame.xyz, step), REPEATS)
    bits["Draco: seconds"] = least_seconds(lambda: draco(frame.xyz, step=step), REPEATS)
    return bits


def frames(paths: list[Path], columns: int, scenes: int, step_deg: float | None) -> Iterator[Frame]:
    """Yield the frames of files, then a turn in each generated street."""
    for path in paths:
        if path.suffix == ".bin":
            values = np.fromfile(path, "<f4").reshape(-1, columns)
            yield Frame(path.stem, values[:, :3].astype(np.float64))
        else:
            yield Frame(path.stem, read_cloud(path).xyz)
    for name in street_names(scenes):
        table = scanned(name, "hdl64e_s2", step_deg=step_deg)
        lasers = table["laser_id"].astype(np.uint8)
        yield Frame(name, table.xyz_noisy, lasers, table["timestamp"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("frames", nargs="*", type=Path)
    parser.add_argument("--columns", type=int, default=4)
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--step-deg", type=float)
    parser.add_argument("--step-mm", type=float, default=1.0)
    options = parser.parse_args()
    given = frames(options.frames, options.columns, options.scenes, options.step_deg)
    table = pd.DataFrame({frame.name: measured(frame, options.step_mm / 1000) for frame in given}).T
    print(table.describe().T[["mean", "min", "max"]].round(3).to_string())
    for name in ("LAZ", "LAZ with time and laser", "Cloudini", "Draco", "differences and LZMA"):
        part = table.filter(regex=f"^{name}, ").dropna()
        if f"{name}, acquired" in part:
            ratios_of = part.div(part[f"{name}, acquired"], axis=0).items()
            relative = {str(label): list(column) for label, column in ratios_of}
            report(f"{name}: bits relative to the acquired order", relative)
    pairs = {
        "equal step": ("Cloudini, acquired", "Draco, acquired"),
        **{name: (f"Cloudini as in {name}", f"Draco as in {name}") for name in DRACO_BITS},
        "seconds of encoding": ("Cloudini: seconds", "Draco: seconds"),
    }
    ratios = {name: list(table[one] / table[other]) for name, (one, other) in pairs.items()}
    report("Cloudini relative to Draco's sequential method", ratios)


if __name__ == "__main__":
    main()

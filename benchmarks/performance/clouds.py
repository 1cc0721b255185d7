"""Bytes and speed of the codec of PointCloud2 messages, beside general compressors.

    python -m benchmarks.performance.clouds [RECORDING ...] [--repeats 3]

Messages with the fields of Velodyne's ROS driver: three turns each of virtual sensors in a room,
and the turns of recordings of Velodynes, whose points are computed in single precision as the
driver does. For each effort: bytes of all messages' data and their ratio to those of `xz -9e`, and
the factor of real time, which is that of messages at 10 Hz. Seconds are the processor's, the least
of the repeats. Zstandard at level 3 is what MCAP uses by default. With pureini, Cloudini's lossless
setting is beside it. Draco and LAZ store coordinates as integers and cannot keep floats.
"""

from __future__ import annotations

import argparse
import lzma
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.performance.rows import Inputs, Row
from benchmarks.turns import virtual_scan
from numpy.typing import NDArray

from pointkit.coding.zstandard import compressed
from pointkit.lidar.sensors import load_sensor
from puck.cloud_data import CloudDecoder, CloudEncoder, CloudField, CloudLayout
from puck.options import EFFORTS, CodingOptions, Effort
from puck.recordings.ouster import metadata_beside
from puck.recordings.packet_turns import split_turns, turn_of
from puckbench.recordings.reading import read_packets
from virtual_lidar import free_origin
from virtual_lidar.scenes.rooms import make_room

SENSORS = ("vlp16", "hdl32e", "hdl64e_s2")
HERTZ = 10.0
ZSTANDARD_LEVEL = 3
AIM = 0.45
POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 16, 20, 24],
        "itemsize": 32,
    }
)
"""A point of Velodyne's ROS driver, with PCL's padding."""
_CODES = {"<f4": 7, "<u2": 4}

Points = NDArray[np.void]


def layout() -> CloudLayout:
    """Return the layout of messages with points of type `POINT`."""
    fields: Mapping[str, Any] = POINT.fields or {}
    codes = [CloudField(name, at[1], _CODES[at[0].str], 1) for name, at in fields.items()]
    return CloudLayout(tuple(codes), POINT.itemsize, False)


def points_of(values: dict[str, NDArray[Any]]) -> Points:
    """Return arrays (n,) by field as points."""
    points = np.zeros(len(values["x"]), POINT)
    for name, array in values.items():
        points[name] = array
    return points


def virtual_clouds(name: str, turns: int) -> list[Points]:
    """Return turns of a virtual sensor in a room, in the sensor's coordinates."""
    table, hertz = virtual_scan(name, turns), load_sensor(name).rotation_hz
    xyz = table.xyz_noisy - np.asarray(free_origin(make_room("office_1", seed=1)))
    number = np.floor(table["timestamp"] * hertz + 1e-9).astype(int)
    clouds = []
    for turn in np.unique(number):
        rows = number == turn
        clouds.append(
            points_of(
                dict(zip("xyz", xyz[rows].T, strict=True))
                | {"ring": table["laser_id"][rows], "time": table["timestamp"][rows] - turn / hertz}
            )
        )
    return clouds


def recorded_clouds(path: Path) -> list[Points]:
    """Return the turns of a Velodyne's recording, in single precision as ROS's driver computes.

    Coordinates are products of tables of sines and cosines, of azimuths in 0.01 degrees.
    """
    single = np.float32
    circle = np.radians(np.arange(36000) / 100)
    cosines, sines = np.cos(circle).astype(single), np.sin(circle).astype(single)
    clouds = []
    for kind, payloads in split_turns(read_packets(path).payloads):
        turn, per_block = turn_of(kind, payloads), kind.layout.columns_per_block
        beams = kind.returns([turn]).beams
        elevations = np.radians(beams.elevations_deg)
        heights = (np.array(beams.heights_mm) / 1000).astype(single)
        up, level = np.sin(elevations).astype(single), np.cos(elevations).astype(single)
        blocks = turn.azimuths.astype(np.int64)
        steps = np.append(np.diff(blocks) % 36000, 0)
        shares = (np.arange(per_block)[:, None] * kind.layout.lasers + np.arange(len(up))) / (
            per_block * kind.layout.lasers
        )
        azimuths = np.rint(blocks[:, None, None] + steps[:, None, None] * shares).astype(np.int64)
        azimuths = azimuths.reshape(-1, len(up)) % 36000
        per_time = per_block * kind.layout.blocks_per_time
        times = np.zeros(1) if turn.times is None else turn.times - turn.times[:1].astype(np.int64)
        columns = np.arange(len(azimuths))
        starts = times[np.minimum(columns // per_time, len(times) - 1)] * 1e-6
        seconds = starts[:, None] + (columns % per_time)[:, None] * 55.296e-6 + 0 * azimuths
        distances = turn.ranges[0].astype(single) * single(0.002)
        flat = distances * level - heights * up
        rows = turn.ranges[0] > 0
        rings = np.broadcast_to(np.argsort(np.argsort(elevations)), rows.shape)
        values = turn.reflectivities
        clouds.append(
            points_of(
                {
                    "x": (flat * cosines[azimuths])[rows],
                    "y": -(flat * sines[azimuths])[rows],
                    "z": (distances * up + heights * level)[rows],
                    "intensity": 0 * distances[rows] if values is None else values[0][rows],
                    "ring": rings[rows],
                    "time": seconds[rows],
                }
            )
        )
    return clouds


def rows(name: str, clouds: Sequence[Points], repeats: int) -> Iterator[Row]:
    """Yield bytes and speeds of messages."""
    data = [points.tobytes() for points in clouds]
    whole = b"".join(data)
    xz = len(lzma.compress(whole, preset=9 | lzma.PRESET_EXTREME))
    yield Row(
        f"{name}: bytes of Zstandard",
        len(compressed(whole, ZSTANDARD_LEVEL)),
        "bytes",
        "xz -9e",
        xz,
    )
    if find_spec("pureini"):
        size = sum(len(in_cloudini(points)) for points in clouds)
        yield Row(f"{name}: bytes of Cloudini", size, "bytes", "xz -9e", xz)
    for effort in EFFORTS:
        bodies, seconds = encoded(data, effort, repeats)
        what = f"{name}, {effort}"
        yield Row(f"{what}: bytes", sum(map(len, bodies)), "bytes", "xz -9e", xz, at_most=AIM)
        for action, least in zip(("encode", "decode"), seconds, strict=True):
            speed = len(data) / HERTZ / least
            aim = 1.0 if effort == "fast" else None
            yield Row(f"{what}: {action}", speed, "x real time", at_least=aim, repeats=repeats)


def encoded(data: list[bytes], effort: Effort, repeats: int) -> tuple[list[bytes], list[float]]:
    """Return coded messages, and the seconds of encoding and of decoding."""
    best, bodies = [np.inf, np.inf], []
    for _ in range(repeats + 1):  # the first compiles
        encoder, decoder = (
            CloudEncoder(layout(), CodingOptions(effort=effort)),
            CloudDecoder(layout()),
        )

        def encode(number: int, message: bytes, encoder: CloudEncoder = encoder) -> bytes:
            count = len(message) // POINT.itemsize
            return encoder.encode(message, count, 1, len(message), is_key=number == 0)

        def decode(body: bytes, decoder: CloudDecoder = decoder) -> bytes:
            return decoder.decode(body, lambda size: None)

        start = time.process_time()
        bodies = [encode(number, message) for number, message in enumerate(data)]
        middle = time.process_time()
        again = [decode(body) for body in bodies]
        end = time.process_time()
        assert again == data
        best = [min(best[0], middle - start), min(best[1], end - middle)]
    return bodies, best


def in_cloudini(points: Points) -> bytes:
    """Return points coded by Cloudini without loss, and by Zstandard."""
    import pureini

    fields = [
        pureini.PointField(one.name, one.offset, pureini.FieldType(one.datatype))
        for one in layout().fields
    ]
    info = pureini.EncodingInfo(
        fields,
        width=len(points),
        point_step=POINT.itemsize,
        encoding_opt=pureini.EncodingOptions.LOSSLESS,
    )
    return bytes(pureini.PointcloudEncoder(info).encode(points.tobytes()))


def measure(inputs: Inputs) -> Iterator[Row]:
    """Turns of virtual sensors and of recordings of Velodynes, as messages."""
    for name in SENSORS[:1] if inputs.is_trial else SENSORS:
        yield from rows(f"virtual {name}", virtual_clouds(name, 3), inputs.repeats(3))
    for path in inputs.recordings:
        if metadata_beside(path) is None:
            yield from rows(path.name, recorded_clouds(path), inputs.repeats(3))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    for name in SENSORS:
        for row in rows(f"virtual {name}", virtual_clouds(name, 3), options.repeats):
            print(row, flush=True)
    for path in options.recordings:
        for row in rows(path.name, recorded_clouds(path), options.repeats):
            print(row, flush=True)


if __name__ == "__main__":
    main()

"""Readers of recordings, settings and weights for benchmarks/checks/fuzz.py, and whole files."""

from __future__ import annotations

import io
import shutil
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from tests.support import bag_files
from tests.support.capture_lookalike import box_capture
from tests.support.file_readers import FileReader

# ---- reading


def _recording(path: Path) -> NDArray[np.float64]:
    """The table of a recording; its turns, where the table is made of packets."""
    from puckbench.recordings.reading import read_recording, read_turns

    table = read_recording(path)
    if path.suffix != ".parquet":
        read_turns(path)
    return table.xyz


def _scan(path: Path) -> NDArray[np.float64]:
    from virtual_lidar.scan_table import read_scan

    return read_scan(path).vectors("x", "y", "z")


def _configuration(path: Path) -> None:
    from puckbench.planning.config import checked, read_config

    checked(read_config(path))


def _weights(path: Path) -> None:
    from pcc_networks.weights_file import read_weights

    read_weights(path)


def _checkpoint(path: Path) -> None:
    from puckbench.scene_sets.tensorflow_checkpoints import read_variables

    read_variables(path.read_bytes(), bytes(1000))


# ---- whole files


def _capture() -> bytes:
    from puckbench.recordings.writing import pcap_bytes

    return pcap_bytes(box_capture(2))


def _write_capture(path: Path) -> None:
    path.write_bytes(_capture())


def _write_pcapng(path: Path) -> None:
    import dpkt

    with path.open("wb") as stream:
        writer = dpkt.pcapng.Writer(stream)
        for _, frame in dpkt.pcap.Reader(io.BytesIO(_capture())):
            writer.writepkt(frame, 5.0)


def _write_mcap(path: Path) -> None:
    path.write_bytes(bag_files.mcap_bytes())


def _write_packed_mcap(path: Path) -> None:
    with TemporaryDirectory() as folder:
        bag_files.ros2_bag(Path(folder, "bag"), "MCAP", "STORAGE")
        shutil.copyfile(next(Path(folder, "bag").glob("*.mcap")), path)


def _write_returns(path: Path) -> None:
    from pointkit.column_tables import write_column_table
    from puck.recordings.packet_turns import decode_packets

    write_column_table(path, decode_packets(box_capture(1).payloads))


def _write_scan(path: Path) -> None:
    from virtual_lidar.scan_table import COLUMNS, ScanTable, write_scan

    columns = {name: np.ones(20, kind) for name, (kind, *_) in COLUMNS.items()}
    write_scan(path, ScanTable(columns, {"sensor": {}}))


def _write_configuration(path: Path) -> None:
    path.write_text(
        "scene_sets:\n  rooms: {loader: rooms, options: {count: 2}}\n"
        "datasets:\n  a: {scene_set: rooms, make: sample, points: 1000}\n"
        "codecs:\n  draco: {rates: [r1, r2]}\nmetrics: [distortion]\nseed: 7\n"
    )


def _write_weights(path: Path) -> None:
    from tests.support.learned_codecs import save_tiny

    save_tiny("pcgcv1", path)


def _write_checkpoint(path: Path) -> None:
    from tests.support.tensorflow_checkpoint import checkpoint

    path.write_bytes(checkpoint({"layer/kernel": np.ones((2, 3), np.float32)})[0])


READERS = {
    "read pcap": FileReader(".pcap", (_write_capture,), _recording),
    "read pcapng": FileReader(".pcapng", (_write_pcapng,), _recording),
    "read bag": FileReader(
        ".bag",
        tuple(partial(bag_files.ros1_bag, compression=kind) for kind in (None, "BZ2", "LZ4")),
        _recording,
    ),
    "read db3": FileReader(".db3", (bag_files.sqlite_bag,), _recording),
    "read mcap": FileReader(".mcap", (_write_mcap, _write_packed_mcap), _recording),
    "read returns": FileReader(".parquet", (_write_returns,), _recording),
    "read scan": FileReader(".parquet", (_write_scan,), _scan),
    "read configuration": FileReader(".yaml", (_write_configuration,), _configuration),
    "read weights": FileReader(".safetensors", (_write_weights,), _weights),
    "read checkpoint": FileReader(".index", (_write_checkpoint,), _checkpoint),
}
"""Readers by the names that benchmarks/checks/fuzz.py gives them."""

"""Readers of every file format for benchmarks/checks/fuzz.py, and whole files to damage."""

from __future__ import annotations

import io
import shutil
import struct
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh
from tests.support import bag_files, e57_files, las_files, structured_files
from tests.support.capture_lookalike import box_capture

Write = Callable[[Path], Any]
Read = Callable[[Path], Any]


@dataclass(frozen=True)
class FileReader:
    """A reader of files: whole ones to damage, and what it makes of a damaged one."""

    suffix: str
    writes: tuple[Write, ...]
    read: Read
    beside: Write | None = None
    """Writes what must stand beside the file."""

    def streams(self) -> list[bytes]:
        """Whole files."""
        result = []
        for write in self.writes:
            with TemporaryDirectory() as folder:
                path = Path(folder, f"a{self.suffix}")
                write(path)
                result.append(path.read_bytes())
        return result

    def decode(self, stream: bytes) -> NDArray[np.float64]:
        """Numbers of a file, which must be finite."""
        folder = Path(mkdtemp(prefix="puckbench-fuzz-"))
        try:
            path = folder / f"a{self.suffix}"
            if self.beside is not None:
                self.beside(path)
            path.write_bytes(stream)
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # a user gets one line
                result = self.read(path)
        finally:
            shutil.rmtree(folder)
        return result if isinstance(result, np.ndarray) else np.zeros(0)

    def structured(self, whole: list[bytes], number: int) -> bytes:
        """A structured file."""
        return structured_files.structured_file(self.suffix, whole, number)


# ---- reading


def _cloud(path: Path) -> NDArray[np.float64]:
    from cloud_files.clouds import read_cloud

    return read_cloud(path).xyz


def _mesh(path: Path) -> NDArray[np.float64]:
    from cloud_files.meshes import read_mesh

    return read_mesh(path).vertices


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


def _results(path: Path) -> None:
    from pointkit.tables import read_table

    read_table(path)


def _residuals(path: Path) -> None:
    from virtual_lidar.residual_table import read_residuals

    read_residuals(path)


def _configuration(path: Path) -> None:
    from puckbench.planning.config import checked, read_config

    checked(read_config(path))


def _description(path: Path) -> NDArray[np.float64]:
    """The cloud of which the file is the description."""
    return _cloud(path.with_suffix(".ply"))


def _weights(path: Path) -> None:
    from pcc_networks.weights_file import read_weights

    read_weights(path)


def _checkpoint(path: Path) -> None:
    from cloud_files.tensorflow_checkpoints import read_variables

    read_variables(path.read_bytes(), bytes(1000))


# ---- whole files


def _points() -> NDArray[np.float64]:
    return np.rint(np.random.default_rng(0).random((40, 3)) * 1000) / 100


def _write_cloud(path: Path) -> None:
    from cloud_files.clouds import write_cloud

    write_cloud(path, PointCloud(_points(), normals=np.eye(3)[np.arange(40) % 3]))


def _write_text_ply(path: Path) -> None:
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat ascii 1.0\nelement vertex 40\n{properties}end_header\n"
    path.write_text(head + _text())


def _text(separator: str = " ", head: str = "") -> str:
    return head + "".join(separator.join(map(str, row)) + "\n" for row in _points().tolist())


def _write_pcd(path: Path, kind: str) -> None:
    points = _points().astype("<f4")
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH 40\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40\nDATA {kind}\n"
    )
    body = {"ascii": _text().encode(), "binary": points.tobytes()}
    if kind == "binary_compressed":
        raw = points.T.tobytes()
        literal = b"".join(
            bytes([len(raw[at : at + 32]) - 1]) + raw[at : at + 32] for at in range(0, len(raw), 32)
        )
        body[kind] = struct.pack("<II", len(literal), len(raw)) + literal
    path.write_bytes(head.encode() + body[kind])


def _write_las(path: Path, point_format: int = 1) -> None:
    import laspy

    version = "1.4" if point_format > 5 else "1.2"
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales = np.full(3, 0.01)
    header.add_extra_dim(laspy.ExtraBytesParams("amplitude", np.float32))
    las = laspy.LasData(header)
    las.x, las.y, las.z = _points().T
    las.write(path)


def _write_las_by_hand(path: Path) -> None:
    keys = las_files.geo_keys((1024, 1), (3072, 2225), (3076, 9003), (4099, 9001))
    steps = (_points() * 100).astype(int).tolist()
    path.write_bytes(las_files.las_bytes(steps, [keys]))


def _write_e57(path: Path) -> None:
    columns = {
        **e57_files.cartesian(_points()),
        "intensity": (e57_files.DOUBLE, np.arange(40.0)),
        "colorRed": ((0, 255), np.arange(40.0)),
        "cartesianInvalidState": ((0, 2), np.zeros(40)),
    }
    turn = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 1.0}
    e57_files.write_e57(path, e57_files.Scan(columns, turn, dict.fromkeys("xyz", 5.0)))


def _write_array(path: Path, kind: str = "<f8") -> None:
    with path.open("wb") as stream:
        np.save(stream, _points().astype(kind))


def _write_named_array(path: Path) -> None:
    rows = np.zeros(40, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2")])
    with path.open("wb") as stream:
        np.save(stream, rows)


def _write_archive(path: Path, compress: bool) -> None:
    with path.open("wb") as stream:
        (np.savez_compressed if compress else np.savez)(stream, points=_points(), t=np.arange(40))


def _write_frame(path: Path) -> None:
    rows = np.column_stack([_points(), np.linspace(0, 1, 40)])
    path.write_bytes(rows.astype("<f4").tobytes())


def _box() -> Any:
    import trimesh

    return trimesh.creation.box((2, 3, 4))


def _write_box(path: Path) -> None:
    _box().export(path)


def _write_mesh(path: Path) -> None:
    from cloud_files.meshes import write_mesh

    write_mesh(path, Mesh(np.asarray(_box().vertices), np.asarray(_box().faces)))


def _write_solid(path: Path) -> None:
    path.write_text(_box().export(file_type="stl_ascii"))


def _write_obj(path: Path) -> None:
    corners = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 1 0\nv 0 2 0\nvt 0 0\nvn 0 0 1\n"
    path.write_text(f"{corners}o a\ng b\nf 1/1/1 2/1/1 3/1/1 4/1/1 5/1/1\nf -5 -4 -3\n")


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


def _write_results(path: Path) -> None:
    import pandas as pd

    table = {"codec": ["a", "b"] * 20, "bits": np.arange(40.0), "points": np.arange(40)}
    pd.DataFrame(table).to_parquet(path)


def _write_configuration(path: Path) -> None:
    path.write_text(
        "scenes:\n  rooms: {loader: rooms, options: {count: 2}}\n"
        "datasets:\n  a: {scenes: rooms, make: sample, points: 1000}\n"
        "codecs:\n  draco: {rates: [r1, r2]}\nmetrics: [distortion]\nseed: 7\n"
    )


def _write_description(path: Path) -> None:
    _write_cloud(path.with_suffix(".ply"))


def _write_weights(path: Path) -> None:
    from tests.support.learned_codecs import save_tiny

    save_tiny("pcgcv1", path)


def _write_checkpoint(path: Path) -> None:
    from tests.support.tensorflow_checkpoint import checkpoint

    path.write_bytes(checkpoint({"layer/kernel": np.ones((2, 3), np.float32)})[0])


def _las_kinds() -> Iterable[Write]:
    return [partial(_write_las, point_format=kind) for kind in (0, 1, 3, 6, 7)]


READERS = {
    "read las": FileReader(".las", (*_las_kinds(), _write_las_by_hand), _cloud),
    "read laz": FileReader(".laz", (*_las_kinds(),), _cloud),
    "read ply": FileReader(".ply", (_write_cloud, _write_text_ply), _cloud),
    "read pcd": FileReader(
        ".pcd",
        tuple(partial(_write_pcd, kind=kind) for kind in ("ascii", "binary", "binary_compressed")),
        _cloud,
    ),
    "read xyz": FileReader(".xyz", (lambda path: path.write_text(_text()),), _cloud),
    "read csv": FileReader(".csv", (lambda path: path.write_text(_text(",", "x,y,z\n")),), _cloud),
    "read pts": FileReader(".pts", (lambda path: path.write_text(_text(" ", "40\n")),), _cloud),
    "read npy": FileReader(
        ".npy", (_write_array, partial(_write_array, kind=">f4"), _write_named_array), _cloud
    ),
    "read npz": FileReader(
        ".npz", tuple(partial(_write_archive, compress=each) for each in (False, True)), _cloud
    ),
    "read bin": FileReader(".bin", (_write_frame,), _cloud),
    "read obj": FileReader(".obj", (_write_obj, _write_box), _mesh),
    "read off": FileReader(".off", (_write_box,), _mesh),
    "read stl": FileReader(".stl", (_write_box, _write_solid), _mesh),
    "read glb": FileReader(".glb", (_write_box,), _mesh),
    "read mesh ply": FileReader(".ply", (_write_mesh, _write_box), _mesh),
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
    "read results": FileReader(".parquet", (_write_results,), _results),
    "read configuration": FileReader(".yaml", (_write_configuration,), _configuration),
    "read description": FileReader(
        ".json", (_write_description,), _description, _write_description
    ),
    "read weights": FileReader(".safetensors", (_write_weights,), _weights),
    "read checkpoint": FileReader(".index", (_write_checkpoint,), _checkpoint),
}
"""Readers by the names that benchmarks/checks/fuzz.py gives them."""
if find_spec("pye57") is not None:
    READERS["read e57"] = FileReader(".e57", (_write_e57,), _cloud)


def outcome(reader: FileReader, data: bytes) -> str:
    """What reading ends in: ``points``, ``error``, or what is wrong."""
    try:
        points = reader.decode(data)
    except InputError as error:
        return "error" if "\n" not in str(error) else "an error of several lines"
    return "points" if np.isfinite(points).all() else "numbers that are not finite"

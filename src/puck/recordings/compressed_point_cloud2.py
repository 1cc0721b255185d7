"""Decompression of point clouds in ROS messages: zlib, Zstandard, Draco and Cloudini."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.isolated import Columns, ParsedFile, parse_isolated
from puck.recordings.point_cloud2 import KINDS, Value, point_columns, point_values

COMPRESSED_POINT_CLOUD2 = "point_cloud_interfaces/msg/CompressedPointCloud2"
DEFINITION = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n"
    "bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] compressed_data\n"
    "bool is_dense\nstring format"
)
"""Definition of the message in ROS's notation."""
_MAX_RATIO = 2000
"""Largest plausible compression ratio; deflate reaches 1032."""
_MAX_NAME_LENGTH = 20
_HEADER = Struct("<5s4BHI")
"""Magic, version, kind, method, flags and number of points of a Draco stream."""
_INEXACT = ("i4", "f8")
"""Types that DracoPy returns in single precision."""
_log = logging.getLogger(__name__)


def decompressed_columns(message: Any) -> Columns:
    """Decompress the points of a deserialised message, and return the fields by name.

    Returns
    -------
    dict of arrays
        The fields, as `point_columns` returns them.

    Raises
    ------
    InputError
        The format is not zlib, zstd, draco or cloudini, or the message is damaged. For cloudini,
        the package pureini must be installed.
    """
    if message.format in _PARSED:
        is_empty = not message.height * message.width
        nothing = np.zeros(0, np.uint8)
        return point_columns(message, nothing) if is_empty else _PARSED[message.format](message)
    if message.format not in _DECOMPRESSORS:
        name, *names = f"{message.format!r:.{_MAX_NAME_LENGTH}}", *_DECOMPRESSORS, *_PARSED
        raise InputError(f"a cloud compressed by {name}, which is not read: {', '.join(names)} are")
    stream = message.compressed_data.tobytes()
    most = max(message.height * message.row_step, message.width * message.point_step)
    if most > _MAX_RATIO * len(stream):
        raise InputError(f"a cloud of {most} bytes in a stream of {len(stream)}")
    name, decompress = _DECOMPRESSORS[message.format]
    try:
        data = decompress(stream, most + 1)
        if len(data) > most:
            raise ValueError("more bytes than the message says")
    except (zlib.error, OSError, ValueError) as error:
        raise InputError(f"the stream is damaged ({name})") from error
    return point_columns(message, np.frombuffer(data, np.uint8))


def _from_zlib(stream: bytes, most: int) -> bytes:
    decoder = zlib.decompressobj(zlib.MAX_WBITS + 32)  # with the header of gzip or zlib
    data = decoder.decompress(stream, most)
    if not decoder.eof:
        raise ValueError("no end")
    return data


def _from_zstd(stream: bytes, most: int) -> bytes:
    import pyarrow as pa

    with pa.input_stream(pa.py_buffer(stream), compression="zstd") as decoder:
        return bytes(decoder.read(most))


_DECOMPRESSORS: dict[str, tuple[str, Callable[[bytes, int], bytes]]] = {
    "zlib": ("zlib", _from_zlib),
    "zstd": ("Zstandard", _from_zstd),
}


def _draco_columns(message: Any) -> Columns:
    stream, count = message.compressed_data.tobytes(), message.height * message.width
    if len(stream) < _HEADER.size or _HEADER.unpack_from(stream)[-1] != count:
        raise InputError(f"the stream is damaged (Draco): not of {count} points")
    attributes = list(_parsed(parse_draco, stream, "Draco stream").columns.values())
    if len(attributes) != len(message.fields) or any(len(part) != count for part in attributes):
        raise InputError("the attributes of the Draco stream are not those of the message")
    columns: Columns = {}
    for value in point_values(message):
        if value.kind.str[1:] in _INEXACT:
            _log.warning("field %.20r is left out: DracoPy would round it", value.name)
            continue
        columns[value.name] = _values(attributes[value.field], value)
    return columns


def _parsed(parse: Callable[[Path], ParsedFile], stream: bytes, kind: str) -> ParsedFile:
    with TemporaryDirectory() as folder:
        path = Path(folder, "cloud")
        path.write_bytes(stream)
        try:
            return parse_isolated(parse, path, kind)
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{path}: ")) from error


def _values(attribute: NDArray[Any], value: Value) -> NDArray[Any]:
    native = value.kind.newbyteorder("=")
    if attribute.dtype == np.uint8 and attribute.shape[1] == native.itemsize > 1:
        return attribute.copy().view(value.kind)[:, 0].astype(native)  # bytes of a packed colour
    if value.part >= attribute.shape[1]:
        raise InputError("the attributes of the Draco stream are not those of the message")
    with np.errstate(invalid="ignore"):
        return attribute[:, value.part].astype(native)


def parse_draco(path: Path) -> ParsedFile:
    """Decode a file with a Draco stream; the result's columns are the attributes (n, values)."""
    try:
        import DracoPy
    except ImportError as error:
        raise InputError("reading Draco takes the package DracoPy (pip install dracopy)") from error
    try:
        attributes = DracoPy.decode(path.read_bytes()).attributes
    except (DracoPy.FileTypeException, ValueError) as error:
        raise InputError("the stream is damaged (Draco)") from error
    return ParsedFile({f"{place}": part["data"] for place, part in enumerate(attributes)})


def _cloudini_columns(message: Any) -> Columns:
    """Return the fields in a Cloudini stream, whose header repeats the message's list of fields."""
    stream = message.compressed_data.tobytes()
    parsed = _parsed(parse_cloudini, stream, "Cloudini stream")
    encoded = {tuple(field) for field in parsed.about["fields"]}
    fields = {(value.offset, value.kind.str[1:]) for value in point_values(message)}
    counts = [message.height * message.width, message.point_step]
    if parsed.about["counts"] != counts or message.is_bigendian or not fields <= encoded:
        raise InputError("the fields of the Cloudini stream are not those of the message")
    return point_columns(message, parsed.columns["data"])


def parse_cloudini(path: Path) -> ParsedFile:
    """Decode a file with a Cloudini stream; the result's column `data` holds the points' bytes."""
    try:
        from pureini import PointcloudDecoder
    except ImportError as error:
        how = "pip install pureini"
        raise InputError(f"reading Cloudini takes the package pureini ({how})") from error
    try:
        data, info = PointcloudDecoder().decode(path.read_bytes())
    except RuntimeError as error:
        raise InputError("the stream is damaged (Cloudini), or newer than version 5") from error
    fields = [(field.offset, KINDS.get(field.type, "")) for field in info.fields]
    about = {"counts": [info.width * info.height, info.point_step], "fields": fields}
    return ParsedFile({"data": np.frombuffer(data, np.uint8)}, about)


_PARSED: dict[str, Callable[[Any], Columns]] = {
    "draco": _draco_columns,
    "cloudini": _cloudini_columns,
}

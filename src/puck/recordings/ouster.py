"""Lidar packets of Ouster sensors, decoded with the sensor's metadata (JSON).

Formats follow the Ouster Firmware User Manual (Lidar Data Packet Format) and the Ouster SDK 1.0.
Points are in Ouster's sensor coordinates, whose x axis is forward.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError, among, naming
from pointkit.files import object_of, read_bytes, write_bytes
from pointkit.lidar.returns import HOUR_US, Beams, Returns
from pointkit.lidar.turns import MAX_LASERS, Layout, Turn

LEGACY = "LEGACY"
_log = logging.getLogger(__name__)
_RADIAL_MM = {"OS-0-": 27.67, "OS-1-": 15.806, "OS-2-": 13.762}
_FIRST_RADIAL_MM, _HEIGHT_MM = 12.163, 36.18
"""The SDK's defaults for metadata that lack them: distance of the beams' origin from the axis by
product line, that of the first OS-1, and height of the lidar's origin in the sensor's frame."""
_COLUMNS = (512, 1024, 2048, 4096)
_MOST_DEG = 90.0
_COARSE_PHOTONS = 16
"""Unit of near infrared light in fields of 8 bits."""
_OSF_MAGIC, _OSF_MAGIC_AT = b"OSF$", 8
_LASERS = (16, 32, 64, 128)
_MOST_LATE = 16
"""Most revolutions by which the counter of revolutions falls unless the sensor starts anew."""
_COLUMNS_PER_PACKET, _USUAL_COLUMNS = range(1, 129), 16
"""Allowed numbers of columns in a packet, and the usual number."""
_HALF_TURN = (-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""The first elements of the transform from lidar to sensor coordinates; the next is the height."""
_TO_SENSOR = (*_HALF_TURN, _HEIGHT_MM, 0.0, 0.0, 0.0, 1.0)


class Field(NamedTuple):
    """Place of a value in the 32-bit words of a pixel: word, first bit, and number of bits."""

    word: int
    bit: int
    bits: int

    def of(self, words: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return the field's value in each pixel.

        Parameters
        ----------
        words
            Pixels (..., words).

        Returns
        -------
        array (...)
            Values, as unsigned 32-bit integers.
        """
        values = (words[..., self.word] >> self.bit) & ((1 << self.bits) - 1)
        return values.astype(np.uint32, copy=False)


class Profile(NamedTuple):
    """Format of a pixel in an Ouster's packets.

    It states the number of 32-bit words, the fields of each kind of return (strongest, second), and
    the quantum of ranges in metres.
    """

    words: int
    ranges: tuple[Field, ...]
    reflectivities: tuple[Field, ...]
    quantum_m: float
    signals: tuple[Field, ...] = ()
    near_infrared: Field | None = None

    def light_of(self, words: NDArray[np.uint32]) -> NDArray[np.uint32] | None:
        """Return the near infrared light in each pixel (..., words), in photons, or None."""
        field = self.near_infrared
        if field is None:
            return None
        return field.of(words) * np.uint32(1 if field.bits == 16 else _COARSE_PHOTONS)


def _fine(
    words: int,
    reflectivity: tuple[int, int],
    signal: tuple[int, int],
    near_infrared: tuple[int, int] | None,
    kinds: int = 1,
    bits: int = 19,
) -> Profile:
    ranges = tuple(Field(kind, 0, bits) for kind in range(kinds))
    reflectivities = tuple(
        Field(reflectivity[0] + kind, reflectivity[1], 8) for kind in range(kinds)
    )
    signals = tuple(Field(signal[0], signal[1] + 16 * kind, 16) for kind in range(kinds))
    light = Field(*near_infrared, 16) if near_infrared else None
    return Profile(words, ranges, reflectivities, 0.001, signals, light)


def _coarse(words: int, kinds: int = 1, *, has_near_infrared: bool = True) -> Profile:
    ranges = tuple(Field(kind, 0, 15) for kind in range(kinds))
    reflectivities = tuple(Field(kind, 16, 8) for kind in range(kinds))
    light = Field(0, 24, 8) if has_near_infrared else None
    return Profile(words, ranges, reflectivities, 0.008, near_infrared=light)


PROFILES = {
    LEGACY: _fine(3, (1, 0), (1, 16), (2, 0), bits=20),
    "RNG19_RFL8_SIG16_NIR16": _fine(3, (1, 0), (1, 16), (2, 0)),
    "RNG19_RFL8_SIG16_NIR16_ZONE16": _fine(3, (1, 0), (1, 16), (2, 0)),
    "RNG19_RFL8_SIG16_NIR16_RGB16": _fine(4, (0, 24), (1, 0), (1, 16)),
    "RNG19_RFL8_SIG16_NIR16_DUAL": _fine(4, (0, 24), (2, 0), (3, 0), kinds=2),
    "RNG19_RFL8_SIG16_ZONE16_DUAL": _fine(4, (0, 24), (2, 0), None, kinds=2),
    "RNG19_RFL8_SIG16_NIR16_RGB16_DUAL": _fine(5, (0, 24), (2, 0), (3, 0), kinds=2),
    "FIVE_WORD_PIXEL": _fine(5, (0, 24), (2, 0), (3, 0), kinds=2),
    "RNG15_RFL8_NIR8": _coarse(1),
    "RNG15_RFL8_WIN8": _coarse(1, has_near_infrared=False),
    "RNG15_RFL8_NIR8_ZONE16": _coarse(2),
    "RNG15_RFL8_NIR8_DUAL": _coarse(2, kinds=2),
    "FUSA_RNG15_RFL8_NIR8_DUAL": _coarse(2, kinds=2),
}
"""Profiles of lidar packets by their name in the metadata (``udp_profile_lidar``).

Compressed recordings store a profile's index; therefore, add new profiles at the end.
"""


def packet_type(
    profile: str, lasers: int, columns: int = _USUAL_COLUMNS, is_fusa: bool = False
) -> np.dtype[Any]:
    """Return the NumPy structure of a packet; bytes that are not decoded belong to no field.

    Parameters
    ----------
    profile
        Name of the profile, a key of `PROFILES`.
    lasers
        Number of lasers of the sensor.
    columns
        Number of columns in a packet.
    is_fusa
        Whether packets have the header of Ouster's functional safety format.
    """
    pixels = ("pixels", "<u4", (lasers, PROFILES[profile].words))
    if profile == LEGACY:
        head = [("time", "<u8"), ("column", "<u2"), ("frame", "<u2"), ("encoder", "<u4")]
        column = np.dtype([*head, pixels, ("status", "<u4")])
        return np.dtype([("columns", column, (columns,))])
    column = np.dtype([("time", "<u8"), ("column", "<u2"), ("status", "<u2"), pixels])
    at, kind, serial = (4, "<u4", 11) if is_fusa else (2, "<u2", 7)
    return np.dtype(
        {
            "names": ["frame", "serial", "columns"],
            "formats": [kind, (np.uint8, (5,)), (column, (columns,))],
            "offsets": [at, serial, 32],
            "itemsize": 64 + columns * column.itemsize,
        }
    )


@dataclass(frozen=True)
class OusterSensor:
    """An Ouster sensor, and the format of its packets.

    `columns` is the number of columns in a revolution. `whole` is the number of columns in the
    azimuth window in which the sensor measures, and `first_column` the number of the first one.
    `assumed` says which of the offsets are the SDK's defaults, since the metadata lack them.
    """

    name: str
    serial: int
    profile: str
    is_fusa: bool
    columns: int
    whole: int
    columns_per_packet: int
    elevations_deg: tuple[float, ...]
    azimuths_deg: tuple[float, ...]
    radial_mm: float
    height_mm: float
    first_column: int = 0
    assumed: tuple[str, ...] = ()

    @property
    def lasers(self) -> int:
        return len(self.elevations_deg)

    @cached_property
    def packet(self) -> np.dtype[Any]:
        """NumPy structure of a packet."""
        return packet_type(self.profile, self.lasers, self.columns_per_packet, self.is_fusa)

    @property
    def beams(self) -> Beams:
        """Directions and offsets of the lasers, in lidar coordinates."""
        none, height = (0.0,) * self.lasers, (self.height_mm,) * self.lasers
        radial = (self.radial_mm,) * self.lasers
        return Beams(
            self.elevations_deg, height, none, azimuths_deg=self.azimuths_deg, radial_mm=radial
        )

    @property
    def layout(self) -> Layout:
        """Arrangement of lasers and columns in the images of turns."""
        ranges = PROFILES[self.profile].ranges
        order = np.argsort(self.elevations_deg, kind="stable")
        shifts = np.rint(np.array(self.azimuths_deg) * self.columns / 360).astype(int)
        return Layout(
            tuple(order.tolist()),
            kinds=len(ranges),
            azimuth_steps=self.columns,
            shifts=tuple(shifts.tolist()),
        )


def is_osf(data: bytes) -> bool:
    """Return whether a file that begins with the bytes `data` is an OSF file of Ouster's SDK."""
    return data[_OSF_MAGIC_AT : _OSF_MAGIC_AT + len(_OSF_MAGIC)] == _OSF_MAGIC


def osf_advice(path: Path) -> str:
    """Return how to convert an OSF file to a recording that is read, as text for a message."""
    command = f"ouster-cli source {path.name} save {path.stem}.pcap"
    return f"an OSF file of Ouster: convert it by the maker's SDK (ouster-sdk): {command}"


def metadata_beside(recording: Path) -> Path | None:
    """Return the JSON file with the metadata of a recording, or None if there is none.

    For ``x.pcap`` this is ``x_0.json``, or else ``x.json``, or else the file with the longest name
    (without suffix) with which ``x`` begins.
    """
    stem = recording.stem
    names = (path for path in recording.parent.glob("*.json") if path.is_file())
    fitting = [path for path in names if stem.startswith(path.stem) or path.stem == f"{stem}_0"]
    return max(fitting, key=lambda path: len(path.stem), default=None)


def all_metadata_beside(recording: Path) -> list[Path]:
    """Return the JSON files that may describe the sensors of a recording.

    The first is that of `metadata_beside`. The others are ``x_0.json``, ``x_1.json`` and so on for
    ``x.pcap``, as the maker's tools name those of several sensors.
    """
    first, stem = metadata_beside(recording), recording.stem
    numbered = [
        path
        for path in sorted(recording.parent.glob("*.json"))
        if path.stem.startswith(f"{stem}_") and path.stem[len(stem) + 1 :].isdecimal()
    ]
    return [*([first] if first else []), *(path for path in numbered if path != first)]


def write_metadata_beside(recording: Path, metadata: bytes) -> None:
    """Write a sensor's metadata to the JSON file beside a recording.

    A file that is there already is kept, and a warning is logged if its content differs.
    """
    beside, place = metadata_beside(recording), recording.with_suffix(".json")
    if beside and read_bytes(beside) == metadata:
        return
    if beside and len(beside.stem) >= len(recording.stem):
        told = "differs from the metadata in the compressed recording and is kept"
        _log.warning("%s: %s", beside, told)
    elif os.path.lexists(place):
        _log.warning("%s: is kept; the metadata of the sensor are not written beside", place)
    else:
        write_bytes(place, metadata)


def sensor_beside(recording: Path, source: Path) -> tuple[OusterSensor, str] | None:
    """Read the metadata in the JSON file beside a recording.

    Parameters
    ----------
    recording
        The recording.
    source
        File of which `recording` is a temporary copy, or the recording itself. If no metadata lie
        beside the copy, those beside this file are read.

    Returns
    -------
    tuple of OusterSensor and str, or None
        The sensor, and the name of the metadata for messages; None if there is no such file.

    Raises
    ------
    InputError
        The file does not contain such metadata.
    """
    if recording != source and (inside := metadata_beside(recording)):
        return read_sensor(inside), f"the metadata in {source.name}"
    beside = metadata_beside(source)
    return (read_sensor(beside), beside.name) if beside else None


def read_sensor(path: Path) -> OusterSensor:
    """Read an Ouster sensor's metadata from a JSON file.

    Raises InputError if the file does not contain such metadata.
    """
    return sensor_of(read_bytes(path), str(path))


def sensor_of(metadata: bytes, name: str) -> OusterSensor:
    """Return the sensor that the metadata of an Ouster describe.

    Parameters
    ----------
    metadata
        The bytes of the JSON document that the sensor's maker calls metadata.
    name
        Name of the document for error messages.

    Returns
    -------
    OusterSensor
        Angles and offsets of the beams, and the format of the packets.

    Raises
    ------
    InputError
        The document does not contain such metadata.
    """
    document = object_of(metadata, name)
    with naming(name):
        try:
            return _sensor(document)
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError("not the metadata of an Ouster sensor") from error


def _sensor(document: Mapping[str, Any]) -> OusterSensor:
    parts = ("sensor_info", "beam_intrinsics", "lidar_intrinsics", "config_params")
    values = {**document}
    for part in parts:
        values |= document.get(part, {})
    packets = document.get("lidar_data_format") or document.get("data_format") or {}
    elevations = _floats(values["beam_altitude_angles"])
    profile = str(packets.get("udp_profile_lidar", LEGACY))
    if profile not in PROFILES:
        raise InputError(f"unknown format of packets '{profile}'{among(profile, PROFILES)}")
    columns = int(packets.get("columns_per_frame") or values["lidar_mode"].partition("x")[0])
    first, last = packets.get("column_window", (0, columns - 1))
    name = str(values.get("prod_line") or "Ouster")
    assumed = []
    to_lidar = _transform(values.get("beam_to_lidar_transform", (0.0,) * 16))
    radial = values.get("lidar_origin_to_beam_origin_mm", to_lidar[3])
    if not radial and "lidar_origin_to_beam_origin_mm" not in values:
        radial = _RADIAL_MM.get(name[:5], _FIRST_RADIAL_MM)
        assumed.append(f"lidar_origin_to_beam_origin_mm ({radial})")
    to_sensor = _transform(values.get("lidar_to_sensor_transform", _TO_SENSOR))
    if "lidar_to_sensor_transform" not in values:
        assumed.append(f"lidar_to_sensor_transform ({_HEIGHT_MM} mm in z)")
    sensor = OusterSensor(
        name=name,
        serial=int(values.get("prod_sn") or 0),
        profile=profile,
        is_fusa="FUSA" in (profile.partition("_")[0], packets.get("header_type")),
        columns=columns,
        whole=(int(last) - int(first)) % columns + 1,
        columns_per_packet=int(packets.get("columns_per_packet", _USUAL_COLUMNS)),
        elevations_deg=elevations,
        azimuths_deg=_floats(values["beam_azimuth_angles"]),
        radial_mm=float(radial),
        height_mm=to_lidar[11] + to_sensor[11],
        first_column=int(first) % columns,
        assumed=tuple(assumed),
    )
    lasers = {len(elevations), len(sensor.azimuths_deg)}
    lasers.add(int(packets.get("pixels_per_column", len(elevations))))
    numbers = (*elevations, *sensor.azimuths_deg, sensor.radial_mm, sensor.height_mm)
    if (
        len(lasers) > 1
        or not 0 < len(elevations) <= MAX_LASERS
        or columns not in _COLUMNS
        or sensor.columns_per_packet not in _COLUMNS_PER_PACKET
        or not np.isfinite(numbers).all()
        or np.abs([*elevations, *sensor.azimuths_deg]).max() > _MOST_DEG
        or to_sensor[:11] != _HALF_TURN
    ):
        raise ValueError("inconsistent")
    return sensor


def _floats(values: Sequence[Any]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _transform(values: Sequence[Any]) -> tuple[float, ...]:
    """Return the 16 numbers of a matrix (4, 4), row by row."""
    numbers = _floats(values)
    if len(numbers) != len(_TO_SENSOR):
        raise ValueError("no matrix of 4 rows and columns")
    return numbers


def is_size_of_packets(size: int) -> bool:
    """Return whether a packet of 16 columns of a known profile can have this size in bytes."""
    return any(size == packet_type(*each).itemsize for each in product(PROFILES, _LASERS))


def serials_of(packets: NDArray[Any]) -> list[int]:
    """Return the serial numbers of sensors in packets (p,), most frequent first.

    Packets of early firmware have none.
    """
    if "serial" not in (packets.dtype.names or ()):
        return []
    rows, counts = np.unique(packets["serial"], axis=0, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return [int.from_bytes(rows[k].tobytes(), "little") for k in order.tolist()]


class OusterTurns(NamedTuple):
    """Revolutions of an Ouster sensor.

    `whole` is the range of indices of the revolutions in `returns` that are not cut off: all but
    the first and the last, and those two if they contain the window's first and last column.
    """

    returns: Returns
    whole: range


def ouster_turns(sensor: OusterSensor, payloads: NDArray[np.uint8]) -> OusterTurns:
    """Decode the packets of an Ouster sensor.

    Repeated columns and columns without data are left out. Times have a resolution of 1 us.

    Parameters
    ----------
    sensor
        The sensor.
    payloads
        Packets (p, size in bytes), which may be in any order within a revolution.

    Returns
    -------
    OusterTurns
        The revolutions, and the indices of the complete ones.
    """
    return decoded_turns(sensor, columns_of_turns(sensor, payloads))


def decoded_turns(sensor: OusterSensor, parts: Sequence[NDArray[Any]]) -> OusterTurns:
    """Decode the columns of each revolution, which `columns_of_turns` returns."""
    profile = PROFILES[sensor.profile]
    turns = tuple(turn_of_columns(profile, part, sensor.columns) for part in parts)
    whole = range(0)
    if parts:
        first, last = (window_places(sensor, parts[k]["column"]) for k in (0, -1))
        whole = range(int(first.min() > 0), len(parts) - int(last.max() < sensor.whole - 1))
    offset = -sensor.radial_mm / 1000
    returns = Returns(sensor.beams, sensor.layout, turns, profile.quantum_m, sensor.name, offset)
    return OusterTurns(returns, whole)


def columns_of_turns(sensor: OusterSensor, payloads: NDArray[np.uint8]) -> list[NDArray[Any]]:
    """Return the structures of the columns of each revolution, sorted and without repeated ones."""
    frames, columns = numbered_columns(sensor, payloads)
    _, rows = np.unique(frames * sensor.columns + columns["column"], return_index=True)
    ends = np.flatnonzero(np.diff(frames[rows])) + 1
    return np.split(columns[rows], ends) if len(rows) else []


def numbered_columns(
    sensor: OusterSensor, payloads: NDArray[np.uint8]
) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return the columns of packets that contain data, and the revolution that each belongs to.

    Returns
    -------
    numbers
        Number of each column's revolution, (c,).
    columns
        Structures of the columns, (c,).
    """
    packets = np.ascontiguousarray(payloads).view(sensor.packet)[:, 0]
    columns = packets["columns"].reshape(-1)
    frames = np.repeat(revolutions(packets), sensor.columns_per_packet)
    is_data = (columns["status"] & 1 == 1) & (columns["column"] < sensor.columns)
    return frames[is_data], columns[is_data]


def window_places(sensor: OusterSensor, numbers: NDArray[np.uint16]) -> NDArray[np.int64]:
    """Return the places of columns among those of the azimuth window, in the order of a revolution.

    Parameters
    ----------
    sensor
        The sensor.
    numbers
        Numbers of columns in the window, (c,).

    Returns
    -------
    array (c,)
        Places, from 0 to `OusterSensor.whole` - 1.
    """
    columns = numbers.astype(np.int64)
    if sensor.first_column + sensor.whole <= sensor.columns:
        return columns - sensor.first_column
    return columns - (sensor.columns - sensor.whole) * (columns >= sensor.first_column)


def packet_times(packets: NDArray[Any]) -> NDArray[np.int64]:
    """Return the time (p,) of each packet's first column that contains data, in ns.

    A packet without data has the time of the packet before.
    """
    columns = packets["columns"]
    is_data = columns["status"] & 1 == 1
    rows = np.arange(len(columns))
    times: NDArray[np.int64] = columns["time"][rows, is_data.argmax(axis=1)].astype(np.int64)
    return times[np.maximum.accumulate(np.where(is_data.any(axis=1), rows, 0))]


def frame_numbers(packets: NDArray[Any]) -> NDArray[np.int64]:
    """Return each packet's counter of revolutions (p,), which wraps around."""
    return _counters(packets).astype(np.int64)


def _counters(packets: NDArray[Any]) -> NDArray[Any]:
    is_legacy = "frame" not in (packets.dtype.names or ())
    return np.asarray(packets["columns"]["frame"][:, 0] if is_legacy else packets["frame"])


def revolutions(packets: NDArray[Any]) -> NDArray[np.int64]:
    """Return the number of the revolution of each packet (p,), which does not wrap around.

    Where the sensor starts anew, the number goes on with the next revolution.
    """
    counters = frame_numbers(packets)
    half = 1 << (8 * _counters(packets).itemsize - 1)
    steps = (np.diff(counters, prepend=counters[:1]) + half) % (2 * half) - half
    return np.cumsum(np.where(steps < -_MOST_LATE, 1, steps))


def turn_of_columns(profile: Profile, columns: NDArray[Any], steps: int) -> Turn:
    """Convert the columns (c,) of a revolution's packets to a turn.

    `steps` is the number of columns in a whole revolution.
    """
    words = columns["pixels"]
    ranges, reflectivities = (
        np.stack([field.of(words) for field in fields])
        for fields in (profile.ranges, profile.reflectivities)
    )
    # The lidar's frame is half a turn from the sensor's.
    azimuths = (columns["column"].astype(np.int64) + steps // 2) % steps
    times = columns["time"] // np.uint64(1000) % np.uint64(HOUR_US)
    return Turn(
        ranges.astype(np.uint32 if profile.ranges[0].bits > 16 else np.uint16),
        azimuths.astype(np.uint16),
        times.astype(np.uint32),
        reflectivities.astype(np.uint8),
    )

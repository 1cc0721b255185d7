from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import NonNegativeFloat, NonNegativeInt

from pointkit.errors import InputError
from pointkit.files import json_bytes, object_of, read_bytes, read_object
from pointkit.models import Model, parsed
from puckbench.core.archives import SUFFIX, read_archive, write_archive

STREAM, RECORD = ".bin", ".json"


REMARK = "remark"
"""Name of the column, in rows of results, with a remark on an unusual result."""


NOT_CODED = "not_coded"
"""Name of the column, in rows of results, that lists the attributes that are not coded."""


USED_RATE = "used_rate"
"""Name of the column, in rows of results at a budget of bits, with the rate that meets it."""


def with_remarks(row: Mapping[str, Any], *remarks: str | None) -> dict[str, Any]:
    """Return a row of results to whose remark further remarks are added; None adds nothing."""
    lines = [*filter(None, (row.get(REMARK), *remarks))]
    return {**row, **({REMARK: "; ".join(lines)} if lines else {})}


class Coded(NamedTuple):
    """A cloud's stream at one rate.

    Parameters
    ----------
    stream
        The bytes from which the codec decodes the cloud.
    record
        Facts about the encoding, such as codec, rate, number of points and seconds. It may be empty
        for a stream from elsewhere.
    """

    stream: bytes
    record: dict[str, Any]


def write_curve(path: Path, coded: Mapping[str, Coded]) -> None:
    """Write a curve, i.e. a cloud's streams at several rates, as an uncompressed ZIP file.

    The stream and the record of a rate ``r1`` are the members ``r1.bin`` and ``r1.json``.

    Parameters
    ----------
    path
        File to write.
    coded
        Streams with their records, by the name of the rate.
    """
    members = {}
    for rate, stream in coded.items():
        members[rate + STREAM] = stream.stream
        members[rate + RECORD] = json_bytes(stream.record)
    write_archive(path, members)


def read_curve(path: str | Path) -> dict[str, Coded]:
    """Return the streams of a curve with their records, by the name of the rate.

    Raises InputError if the file is not a curve as `write_curve` writes it.
    """
    path = Path(path)
    members = read_archive(path)
    rates = [name.removesuffix(STREAM) for name in members if name.endswith(STREAM)]
    if odd := [rate for rate in rates if "/" in rate or not rate]:
        raise InputError(f"{path}: not a curve: its member {odd[0] + STREAM!r} is not RATE{STREAM}")
    if not rates:
        raise InputError(f"{path}: an archive without streams (r1{STREAM}, ...)")
    return {rate: _coded(path, members, rate) for rate in rates}


def _coded(path: Path, members: Mapping[str, bytes], rate: str) -> Coded:
    what = f"{path}: {rate}{RECORD}"
    record = object_of(members.get(rate + RECORD, b"{}"), what)
    return Coded(members[rate + STREAM], _checked(record, what))


class _Record(Model, extra="ignore"):
    codec: str = ""
    rate: str = ""
    codec_version: str = ""
    bytes: NonNegativeInt = 0
    points_in: NonNegativeInt = 0
    bpp: NonNegativeFloat = 0.0
    encode_s: NonNegativeFloat = 0.0


def _checked(record: dict[str, Any], what: str) -> dict[str, Any]:
    parsed(_Record, record, what)
    return record


def read_coded(path: Path, rate: str | None = None) -> Coded:
    """Return a stream and its record, from a file of one stream or from a curve.

    Parameters
    ----------
    path
        File of a stream, whose record is in the file `record_file` if it exists; or a curve
        (``.zip``).
    rate
        Name of the rate to read from a curve; by default the only rate.

    Raises
    ------
    InputError
        The curve lacks the rate, or has several rates and `rate` is None; or the file has one
        stream, which is not of this rate.
    """
    if path.suffix.lower() != SUFFIX:
        beside = record_file(path)
        record = read_object(beside) if beside.exists() else {}
        if rate not in (None, record.get("rate")):
            raise InputError(f"{path}: one stream, not a curve with rates (--rate {rate})")
        return Coded(read_bytes(path), _checked(record, str(beside)))
    curve = read_curve(path)
    if rate is None and len(curve) == 1:
        (rate,) = curve
    if rate not in curve:
        fault = "name one of its rates" if rate is None else f"no rate '{rate}'"
        raise InputError(f"{path}: {fault} (--rate: {', '.join(curve)})")
    return curve[rate]


def record_file(stream: Path) -> Path:
    """Return the path of the record (JSON) beside a file of one stream."""
    return stream.with_name(f"{stream.name}.json")

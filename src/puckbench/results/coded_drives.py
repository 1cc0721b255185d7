from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from pointkit.files import json_bytes, object_of
from puckbench.core.archives import read_archive, write_archive
from puckbench.results.curves import RECORD, STREAM


@dataclass(frozen=True)
class CodedDrive:
    """A drive that was encoded at one rate.

    Parameters
    ----------
    streams
        One stream for each turn, i.e. for each revolution of the sensor.
    record
        Facts about the encoding of all turns, such as codec, rate, bytes and seconds.
    """

    streams: tuple[bytes, ...]
    record: Mapping[str, Any]


def write_coded_drive(path: Path, rates: Mapping[str, CodedDrive]) -> None:
    """Write a drive that was encoded at several rates, given by name, to one ZIP file."""
    members: dict[str, bytes] = {}
    for rate, coded in rates.items():
        members[rate + RECORD] = json_bytes(coded.record)
        members |= {f"{rate}/{k:04d}{STREAM}": each for k, each in enumerate(coded.streams)}
    write_archive(path, members)


def read_coded_drive(path: Path) -> dict[str, CodedDrive]:
    """Return an encoded drive by rate; raise InputError if the file is not one."""
    members = read_archive(path)
    rates = {}
    for name, data in members.items():
        if "/" not in name and name.endswith(RECORD):
            rate = name.removesuffix(RECORD)
            streams = tuple(members[key] for key in members if key.startswith(f"{rate}/"))
            rates[rate] = CodedDrive(streams, object_of(data, f"{path}: {name}"))
    if not rates or not all(coded.streams for coded in rates.values()):
        raise InputError(f"{path}: not an archive of coded turns")
    return rates

"""Choice of a sensor's data packets among a capture's datagrams, and counts of the others."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import IntEnum
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError, counted
from puck.recordings.ouster import is_size_of_packets, sensor_beside
from puck.recordings.ouster_logs import ouster_log
from puck.recordings.packet_turns import SENSORS, is_whole, kind_codes
from puck.recordings.packets import (
    BANK_FLAGS,
    BLOCKS,
    MODES,
    PACKET,
    PACKET_BYTES,
    PRODUCTS,
    PacketLog,
    joined,
)
from puck.recordings.pcap import Capture, Datagram, Stream

LEFT_OUT = {
    "repeated_packets": "packets that repeat one before, byte by byte",
    "damaged_packets": "damaged packets",
    "unknown_packets": "packets of unknown sensors or return modes",
    "foreign_packets": f"datagrams of {PACKET_BYTES:,} bytes that no Velodyne sent",
    "cut_packets": "packets cut by the snap length",
    "bytes_cut_off": "bytes of a last packet that is not whole",
}
"""Names and descriptions of the counts of data that are left out of a recording."""
_MOST_LISTED = 4


class PayloadKind(IntEnum):
    """Kinds of UDP payloads that have the size of a Velodyne data packet, 1,206 bytes.

    WHOLE packets can be decoded; FOREIGN payloads are not from a Velodyne.
    """

    WHOLE, DAMAGED, UNKNOWN, FOREIGN = range(4)


def payload_kinds(payloads: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Return the kind of each payload (p, 1206) as an array (p,) of `PayloadKind` numbers."""
    packets = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    flags = np.isin(packets["blocks"]["flag"], BANK_FLAGS).sum(axis=1)
    codes = kind_codes(payloads)
    has_known_kind = np.isin(codes[:, 0], list(PRODUCTS)) & np.isin(codes[:, 1], list(MODES))
    return np.select(
        [2 * flags <= BLOCKS, ~is_whole(payloads, codes), ~has_known_kind],
        [PayloadKind.FOREIGN, PayloadKind.DAMAGED, PayloadKind.UNKNOWN],
        PayloadKind.WHOLE,
    ).astype(np.int8)


def packets_of_capture(capture: Capture, name: str | None = None) -> PacketLog:
    """Return the undamaged data packets of one stream of a packet capture.

    Parameters
    ----------
    capture
        Datagrams of the capture.
    name
        The stream, as ``sender:port to receiver:port`` or the beginning of this text. None selects
        the only stream with data packets.

    Returns
    -------
    PacketLog
        The packets. The attribute `about` counts the data left out (see `LEFT_OUT`).
    """
    sized = [datagram for datagram in capture.datagrams if datagram.length == PACKET_BYTES]
    payloads = joined([datagram.payload for datagram in sized], [], {}).payloads
    kinds = payload_kinds(payloads)
    if not (kinds == PayloadKind.WHOLE).any():
        raise InputError(_why_none(capture, payloads, kinds))
    stream = _select_stream(list(compress(sized, kinds == PayloadKind.WHOLE)), name, _products)
    velodyne = compress(sized, kinds != PayloadKind.FOREIGN)
    packets = [datagram for datagram in velodyne if datagram.stream == stream]
    about = {"format": "pcap", **_counts(capture, len(packets))}
    if foreign := int((kinds == PayloadKind.FOREIGN).sum()):
        about["foreign_packets"] = foreign
    del payloads  # as large as the recording
    received = [packet.received for packet in packets]
    return whole_packets([packet.payload for packet in packets], received, about)


def ouster_packets(
    capture: Capture, recording: Path, source: Path, name: str | None = None
) -> PacketLog | None:
    """Return the packets of an Ouster sensor, or None if the capture seems to have none.

    The sensor's metadata are read from a file beside the recording or beside `source`, of which it
    may be a copy (see `ouster.sensor_beside`). The argument `name` selects a stream as in
    `packets_of_capture`.
    """
    sizes = Counter(datagram.length for datagram in capture.datagrams)
    if PACKET_BYTES in sizes:
        return None
    beside = sensor_beside(recording, source)
    if beside is None:
        size = next((size for size, _ in sizes.most_common() if is_size_of_packets(size)), None)
        if size is None:
            return None
        raise InputError(
            f"{sizes[size]:,} datagrams of {size:,} bytes, as an Ouster sends: put the metadata of "
            f"the sensor beside it ({source.stem}.json)"
        )
    sensor, metadata = beside
    size = sensor.packet.itemsize
    sized = [datagram for datagram in capture.datagrams if datagram.length == size]
    described = f"{metadata} ({sensor.name}, {sensor.profile}, packets of {size:,} bytes)"
    if not sized:
        raise InputError(f"{capture.contents()}, which {described} does not describe")
    stream = _select_stream(sized, name, lambda _: sensor.name)
    packets = [datagram for datagram in sized if datagram.stream == stream]
    about = {"format": "pcap", **_counts(capture, len(packets), size)}
    received = [packet.received for packet in packets]
    payloads = [packet.payload for packet in packets]
    return ouster_log(sensor, payloads, received, about, described)


def whole_packets(
    payloads: Sequence[bytes], received: Sequence[float], about: dict[str, Any]
) -> PacketLog:
    """Return the undamaged packets among payloads, without repeated ones.

    Parameters
    ----------
    payloads
        Contents of 1,206 bytes each.
    received
        Times of reception, in seconds.
    about
        Facts about the recording. In the result, counts of payloads left out are added.
    """
    first: dict[bytes, float] = {}
    for payload, time in zip(payloads, received, strict=True):
        first.setdefault(payload, time)
    log = joined(list(first), list(first.values()), {})
    kinds = payload_kinds(log.payloads)
    is_data = kinds == PayloadKind.WHOLE
    if len(payloads) and not is_data.any():
        raise InputError(f"no whole data packet of a Velodyne: {_faults(log.payloads, kinds)}")
    counts = {
        "repeated_packets": len(payloads) - len(log),
        "damaged_packets": int((kinds == PayloadKind.DAMAGED).sum()),
        "unknown_packets": int((kinds == PayloadKind.UNKNOWN).sum()),
        "foreign_packets": int((kinds == PayloadKind.FOREIGN).sum()),
    }
    counted = {**about, **{name: count for name, count in counts.items() if count}}
    if not is_data.all():
        log = PacketLog(log.payloads[is_data], log.received[is_data])
    return replace(log, about=counted)


def log_left_out(path: Path, about: Mapping[str, Any]) -> None:
    """Log a warning about the data of a recording that were left out, which `about` counts."""
    parts = [f"{what} ({about[name]:,})" for name, what in LEFT_OUT.items() if about.get(name)]
    if parts:
        logging.getLogger(__name__).warning("%s: left out %s", path, ", ".join(parts))


def _counts(capture: Capture, packets: int, size: int = PACKET_BYTES) -> dict[str, int]:
    datagrams = len(capture.datagrams) - packets
    parts = {"cut_packets": _cut_packets(capture, size), "fragments": capture.fragments}
    return {
        "other_packets": datagrams + capture.others + capture.cut + capture.fragments,
        "bytes_cut_off": capture.bytes_cut_off,
        **{name: count for name, count in parts.items() if count},
    }


def _cut_packets(capture: Capture, size: int = PACKET_BYTES) -> int:
    return sum(count for (length, _), count in capture.cut_sizes.items() if length == size)


def _select_stream(
    packets: Sequence[Datagram], name: str | None, sensor: Callable[[Sequence[Datagram]], str]
) -> Stream:
    streams = Counter(packet.stream for packet in packets)
    matches = [stream for stream in streams if name is None or _is_named(stream, name)]
    if len(matches) == 1:
        return matches[0]
    described = []
    for stream in list(streams)[:_MOST_LISTED]:
        some = [packet for packet in packets if packet.stream == stream]
        described.append(f"{stream}, {counted(len(some), 'packet')} of {sensor(some)}")
    listed = "; ".join(described)
    more = "; ..." if len(streams) > _MOST_LISTED else ""
    fault = "" if name is None else f", {len(matches) or 'none'} of them '{name}'"
    raise InputError(
        f"data packets of {len(streams)} streams{fault} ({listed}{more}): choose one by --stream "
        "or the option stream"
    )


def _is_named(stream: Stream, name: str) -> bool:
    full_name = f"{stream}"
    return full_name.startswith(name) and full_name[len(name) : len(name) + 1] in ("", ":", " ")


def _products(packets: Sequence[Datagram]) -> str:
    payloads = joined([packet.payload for packet in packets], [], {}).payloads
    return " and ".join(
        PRODUCTS[code] for code in dict.fromkeys(kind_codes(payloads)[:, 0].tolist())
    )


def _why_none(capture: Capture, payloads: NDArray[np.uint8], kinds: NDArray[np.int8]) -> str:
    faults = f" ({_faults(payloads, kinds)})" if len(payloads) else ""
    read = ", ".join(PRODUCTS[each] for each in SENSORS)
    advice = f"recordings of {read} and Ouster are read; of another sensor, clouds"
    if _cut_packets(capture):
        advice = "record whole packets (tcpdump -s 0)"
    elif capture.fragments:
        advice = "other fragments are missing"
    return (
        f"no whole data packet of a Velodyne ({PACKET_BYTES:,} bytes), but "
        f"{capture.contents()}{faults}: {advice}"
    )


def _faults(payloads: NDArray[np.uint8], kinds: NDArray[np.int8]) -> str:
    packets = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    ends = Counter(packets[kinds == PayloadKind.UNKNOWN][["product", "mode"]].tolist())
    is_foreign = kinds == PayloadKind.FOREIGN
    counts = {
        **{
            f"of product 0x{product:02X} and return mode 0x{mode:02X}": count
            for (product, mode), count in ends.most_common(_MOST_LISTED)
        },
        "damaged": int((kinds == PayloadKind.DAMAGED).sum()),
        "without the flags of a Velodyne": int(is_foreign.sum()),
    }
    return ", ".join(f"{count:,} {what}" for what, count in counts.items() if count)

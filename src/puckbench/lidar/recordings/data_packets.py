"""Data packets of one sensor among the datagrams of a capture or the packets of a bag."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from enum import IntEnum
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.io.recordings.pcap import Capture, Datagram, Stream
from puckbench.lidar.recordings.packet_turns import is_whole
from puckbench.lidar.recordings.packets import (
    BLOCKS,
    FLAG,
    MODES,
    PACKET,
    PACKET_BYTES,
    PRODUCTS,
    PacketLog,
    joined,
)

LEFT_OUT = {
    "repeated_packets": "packets that repeat one before, byte by byte",
    "damaged_packets": "damaged packets",
    "unknown_packets": "packets of unknown sensors or return modes",
    "foreign_packets": f"datagrams of {PACKET_BYTES:,} bytes that no Velodyne sent",
    "cut_packets": "packets cut by the snap length",
    "bytes_cut_off": "bytes of a last packet that is not whole",
}
"""Counts of what is left out of a recording, and what they count."""
_MOST_LISTED = 4
_HDL64E_FLAGS = (0xEEFF, 0xDDFF)
_READ = ("VLP-16", "Puck Hi-Res", "HDL-32E")


class Kind(IntEnum):
    """What a payload of the size of a data packet is."""

    WHOLE, DAMAGED, UNKNOWN, FOREIGN = range(4)


def kinds_of(payloads: NDArray[np.uint8]) -> NDArray[np.int8]:
    """The `Kind` of payloads (p, 1206).

    A packet of a Velodyne has the flag of most of its blocks, a product and a return mode.
    """
    packets = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    flags = (packets["blocks"]["flag"] == FLAG).sum(axis=1)
    is_known = np.isin(packets["product"], list(PRODUCTS)) & np.isin(packets["mode"], list(MODES))
    return np.select(
        [2 * flags <= BLOCKS, ~is_whole(payloads), ~is_known],
        [Kind.FOREIGN, Kind.DAMAGED, Kind.UNKNOWN],
        Kind.WHOLE,
    ).astype(np.int8)


def packets_of_capture(capture: Capture, name: str | None = None) -> PacketLog:
    """The whole data packets of one stream of a capture.

    Parameters
    ----------
    capture
        Its datagrams.
    name
        Of the stream, ``sender:port to receiver:port`` or the beginning of that; None for the only
        one that has data packets.

    Returns
    -------
    PacketLog
        `about` counts all packets that are none of the stream's as `other_packets`, and what is
        left out (`LEFT_OUT`).

    Raises
    ------
    InputError
        There is no whole data packet, or no single stream of the name.
    """
    sized = [one for one in capture.datagrams if one.length == PACKET_BYTES]
    payloads = joined([one.payload for one in sized], [], {}).payloads
    kinds = kinds_of(payloads)
    if not (kinds == Kind.WHOLE).any():
        raise InputError(_why_none(capture, payloads, kinds))
    stream = _chosen(list(compress(sized, kinds == Kind.WHOLE)), name)
    own = [one for one in compress(sized, kinds != Kind.FOREIGN) if one.stream == stream]
    about = {"format": "pcap", **_counts(capture, len(own), kinds)}
    return whole_packets([one.payload for one in own], [one.received for one in own], about)


def whole_packets(
    payloads: Sequence[bytes], received: Sequence[float], about: dict[str, Any]
) -> PacketLog:
    """The whole packets among payloads of 1,206 bytes, each once; others are counted in `about`.

    Two packets of a sensor differ at least in their times.

    Raises
    ------
    InputError
        There are payloads, and none is whole.
    """
    first: dict[bytes, float] = {}
    for payload, time in zip(payloads, received, strict=True):
        first.setdefault(payload, time)
    log = joined(list(first), list(first.values()), {})
    kinds = kinds_of(log.payloads)
    is_data = kinds == Kind.WHOLE
    if len(payloads) and not is_data.any():
        raise InputError(f"no whole data packet of a Velodyne: {_faults(log.payloads, kinds)}")
    counts = {
        "repeated_packets": len(payloads) - len(log),
        "damaged_packets": int((kinds == Kind.DAMAGED).sum()),
        "unknown_packets": int((kinds == Kind.UNKNOWN).sum()),
        "foreign_packets": int((kinds == Kind.FOREIGN).sum()),
    }
    counted = {**about, **{name: count for name, count in counts.items() if count}}
    return PacketLog(log.payloads[is_data], log.received[is_data], counted)


def remark(path: Path, about: Mapping[str, Any]) -> None:
    """Log what was left out of a recording, by the counts of its log."""
    parts = [f"{what} ({about[name]:,})" for name, what in LEFT_OUT.items() if about.get(name)]
    if parts:
        logging.getLogger(__name__).warning("%s: left out %s", path, ", ".join(parts))


def _counts(capture: Capture, packets: int, kinds: NDArray[np.int8]) -> dict[str, int]:
    """What a capture has beside the packets of a stream; counts above 0 of its parts."""
    datagrams = len(capture.datagrams) - packets
    parts = {
        "foreign_packets": int((kinds == Kind.FOREIGN).sum()),
        "cut_packets": _cut_packets(capture),
        "fragments": capture.fragments,
    }
    return {
        "other_packets": datagrams + capture.others + capture.cut + capture.fragments,
        "bytes_cut_off": capture.bytes_cut_off,
        **{name: count for name, count in parts.items() if count},
    }


def _cut_packets(capture: Capture) -> int:
    """Number of datagrams of the size of data packets that are cut."""
    return sum(count for (size, _), count in capture.cut_sizes.items() if size == PACKET_BYTES)


def _chosen(packets: Sequence[Datagram], name: str | None) -> Stream:
    """The only stream of data packets, or the one of a name."""
    streams = Counter(one.stream for one in packets)
    chosen = [stream for stream in streams if name is None or _is_named(stream, name)]
    if len(chosen) == 1:
        return chosen[0]
    listed = "; ".join(_described(stream, packets) for stream in list(streams)[:_MOST_LISTED])
    more = "; ..." if len(streams) > _MOST_LISTED else ""
    fault = "" if name is None else f", {len(chosen) or 'none'} of them '{name}'"
    raise InputError(
        f"data packets of {len(streams)} streams{fault} ({listed}{more}): choose one by --stream "
        "or the option stream"
    )


def _is_named(stream: Stream, name: str) -> bool:
    whole = f"{stream}"
    return whole.startswith(name) and whole[len(name) : len(name) + 1] in ("", ":", " ")


def _described(stream: Stream, packets: Sequence[Datagram]) -> str:
    products = Counter(one.payload[-1] for one in packets if one.stream == stream)
    sensors = " and ".join(PRODUCTS[product] for product in products)
    count = products.total()
    return f"{stream}, {count:,} packet{'s' * (count != 1)} of {sensors}"


def _why_none(capture: Capture, payloads: NDArray[np.uint8], kinds: NDArray[np.int8]) -> str:
    """What a capture without a whole data packet holds, and what to do."""
    faults = f" ({_faults(payloads, kinds)})" if len(payloads) else ""
    advice = f"read are recordings of {', '.join(_READ)}; of another sensor, clouds"
    if _cut_packets(capture):
        advice = "record whole packets (tcpdump -s 0)"
    elif capture.fragments:
        advice = "fragments are not put together"
    return (
        f"no whole data packet of a Velodyne ({PACKET_BYTES:,} bytes), but "
        f"{capture.contents()}{faults}: {advice}"
    )


def _faults(payloads: NDArray[np.uint8], kinds: NDArray[np.int8]) -> str:
    """What is wrong with packets of which none is whole."""
    packets = np.ascontiguousarray(payloads).view(PACKET)[:, 0]
    ends = Counter(packets[kinds == Kind.UNKNOWN][["product", "mode"]].tolist())
    is_64 = np.isin(packets["blocks"]["flag"], _HDL64E_FLAGS).all(axis=1) & (kinds == Kind.FOREIGN)
    counts = {
        **{
            f"of product 0x{product:02X} and return mode 0x{mode:02X}": count
            for (product, mode), count in ends.most_common(_MOST_LISTED)
        },
        "damaged": int((kinds == Kind.DAMAGED).sum()),
        "of an HDL-64E": int(is_64.sum()),
        "without the flags of a Velodyne": int((kinds == Kind.FOREIGN).sum() - is_64.sum()),
    }
    return ", ".join(f"{count:,} {what}" for what, count in counts.items() if count)

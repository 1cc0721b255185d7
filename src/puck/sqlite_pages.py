"""Page links of SQLite files, such as ROS 2 bags.

An overflow page begins with the number of the next page. The first four bytes of all pages are
coded separately, so that packets are contiguous in the other bytes.
"""

from __future__ import annotations

import numpy as np

from puck.gaps import MOST_RAW_BYTES, Bytes

LINK_BYTES = 4
SMALLEST_PAGE, LARGEST_PAGE = 512, 1 << 16
_MAGIC = b"SQLite format 3\x00"


def page_size(data: Bytes) -> int:
    """Return the page size in bytes if `data` is a complete SQLite file, and 0 otherwise."""
    if data[: len(_MAGIC)].tobytes() != _MAGIC or len(data) < SMALLEST_PAGE:
        return 0
    size = int.from_bytes(data[16:18].tobytes(), "big")
    size = LARGEST_PAGE if size == 1 else size
    if size < SMALLEST_PAGE or len(data) % size:
        return 0
    return 0 if len(data) // size * LINK_BYTES > MOST_RAW_BYTES else size


def without_links(data: Bytes, page: int, first: int, end: int) -> Bytes:
    """Return the bytes from `first` to `end` of a file without page links.

    `page` is the page size in bytes, or 0 for a file without links.
    """
    if not page:
        return data[first:end]
    content = page - LINK_BYTES
    start = first // content
    part = data.reshape(-1, page)[start : -(-end // content), LINK_BYTES:].ravel()
    return part[first - start * content : end - start * content]


def encode_links(links: Bytes) -> bytes:
    """Return page links (n, 4), which are big-endian numbers, as differences in bytes.

    The highest bytes of all links come first.
    """
    numbers = np.ascontiguousarray(links).view(">u4")[:, 0].astype(np.uint32)
    steps = np.diff(numbers, prepend=np.uint32(0)).astype(">u4")
    return steps.view(np.uint8).reshape(-1, LINK_BYTES).T.tobytes()


def decode_links(body: bytes) -> Bytes:
    """Return the links (n, 4) that `encode_links` encoded."""
    planes = np.frombuffer(body, np.uint8).reshape(LINK_BYTES, -1).T
    steps = np.ascontiguousarray(planes).view(">u4")[:, 0].astype(np.uint32)
    numbers = np.cumsum(steps, dtype=np.uint32).astype(">u4")
    return numbers.view(np.uint8).reshape(-1, LINK_BYTES)

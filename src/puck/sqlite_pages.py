"""Page links of SQLite files, such as ROS 2 bags.

An overflow page begins with the number of the next page. The first four bytes of all pages are
coded separately, so that packets are contiguous in the other bytes.
"""

from __future__ import annotations

import numpy as np

from puck.gaps import MOST_RAW_BYTES, Bytes

LINK_BYTES = 4
SMALLEST_PAGE, LARGEST_PAGE = 512, 1 << 16
MAGIC = b"SQLite format 3\x00"


def page_size(start: bytes, size: int) -> int:
    """Return the page size in bytes of a complete SQLite file, and 0 for other files.

    `start` are the first bytes of the file, at least 18, and `size` is its size in bytes.
    """
    if start[: len(MAGIC)] != MAGIC or size < SMALLEST_PAGE:
        return 0
    page = int.from_bytes(start[16:18], "big")
    page = LARGEST_PAGE if page == 1 else page
    if page < SMALLEST_PAGE or size % page:
        return 0
    return 0 if size // page * LINK_BYTES > MOST_RAW_BYTES else page


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

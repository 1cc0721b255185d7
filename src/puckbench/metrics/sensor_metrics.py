"""Errors of a codec in a sensor's returns, and its speed in turns of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.geometry.cloud import Floats

if TYPE_CHECKING:
    from puckbench.lidar.returns import Returns


def range_errors(original: Returns, decoded: Returns) -> dict[str, float]:
    """Errors of ranges, firing by firing, and returns that were lost or added.

    Parameters
    ----------
    original, decoded
        Returns of the same firings.

    Returns
    -------
    dict
        ``range_rms_mm`` and ``range_max_mm`` over firings with a return in both; ``returns_lost``
        and ``returns_added``.

    Raises
    ------
    InputError
        The numbers of turns, columns or lasers differ.
    """
    pairs = list(zip(original.turns, decoded.turns, strict=False))
    if len(original.turns) != len(decoded.turns) or any(
        one.ranges.shape != other.ranges.shape for one, other in pairs
    ):
        raise InputError("the decoded returns have other numbers of turns, columns or lasers")
    squared, most, both, lost, added = 0.0, 0.0, 0, 0, 0
    for one, other in pairs:
        was, is_now = one.ranges > 0, other.ranges > 0
        lost += int(np.count_nonzero(was & ~is_now))
        added += int(np.count_nonzero(is_now & ~was))
        kept = was & is_now
        error = (
            other.ranges[kept] * decoded.quantum_m - one.ranges[kept] * original.quantum_m
        ) * 1000
        both += len(error)
        squared += float(error @ error)
        most = max(most, float(np.abs(error).max(initial=0.0)))
    rms = {"range_rms_mm": float(np.sqrt(squared / both)), "range_max_mm": most} if both else {}
    return {**rms, "returns_lost": lost, "returns_added": added}


def range_errors_of_points(original: Floats, decoded: Floats) -> dict[str, float]:
    """Errors of ranges where a codec gives back points alone: against the nearest of them.

    The error of a return is how far its nearest decoded point is off along its ray. Returns whose
    nearest point is that of more returns than there are points are lost (merged, most of all);
    points that are the nearest of no return are added.

    Parameters
    ----------
    original
        (n, 3) of the returns, as the sensor at the origin sees them, m.
    decoded
        (m, 3) in any order, likewise.

    Returns
    -------
    dict
        As of `range_errors`.
    """
    from pykdtree.kdtree import KDTree

    places, held = np.unique(decoded, axis=0, return_counts=True)
    nearest = KDTree(places).query(np.ascontiguousarray(original))[1].astype(np.int64)
    length = np.linalg.norm(original, axis=1)
    along = np.einsum("ij,ij->i", places[nearest] - original, original)
    error = 1000 * along / np.maximum(length, 1e-9)
    taken = np.bincount(nearest, minlength=len(places))
    return {
        "range_rms_mm": float(np.sqrt(np.mean(error**2))),
        "range_max_mm": float(np.abs(error).max()),
        "returns_lost": int(np.maximum(taken - held, 0).sum()),
        "returns_added": int(np.maximum(held - taken, 0).sum()),
    }


def entropy_bits(noise: Floats, groups: NDArray[np.integer], step: float) -> float:
    """Entropy of noise in whole steps: the bits that coding it takes at least.

    Parameters
    ----------
    noise
        (n,) in the unit of `step`.
    groups
        (n,) numbers from 0 on. The mean of each group (of a laser in a turn) is subtracted first:
        a codec can learn it.
    step
        What it is rounded to.

    References
    ----------
    G. A. Miller, "Note on the bias of information estimates", 1955: (number of values - 1) / 2n
    nats are added.
    """
    means = np.bincount(groups, noise) / np.maximum(np.bincount(groups), 1)
    counts = np.unique(np.rint((noise - means[groups]) / step), return_counts=True)[1]
    if len(counts) < 2:
        return 0.0
    shares = counts / counts.sum()
    nats = -float(shares @ np.log(shares)) + (len(counts) - 1) / (2 * len(noise))
    return nats / float(np.log(2))


def keeping_up(about: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, float]:
    """Bitrate of a stream at the sensor's speed, and speed of the codec in turns of the sensor.

    Parameters
    ----------
    about
        Of the cloud that was coded: ``turns`` and ``seconds``; without them nothing is returned.
    row
        The result row so far: ``bytes``, ``encode_s``, ``decode_s``.

    Returns
    -------
    dict
        ``mbit_per_s`` at the sensor's rate; ``encode_ms_per_turn`` and ``encode_real_time`` (the
        turns' time over the codec's), likewise of decoding.
    """
    turns, seconds = about.get("turns"), about.get("seconds")
    if not turns or not seconds:
        return {}
    found = {"mbit_per_s": row["bytes"] * 8e-6 / seconds} if "bytes" in row else {}
    for call in ("encode", "decode"):
        if taken := row.get(f"{call}_s"):
            found[f"{call}_ms_per_turn"] = 1000 * taken / turns
            found[f"{call}_real_time"] = seconds / taken
    return found

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats

if TYPE_CHECKING:
    from pointkit.geometry.cloud import PointCloud
    from pointkit.lidar.returns import Returns

_OCTILES = 8


def range_errors(original: Returns, decoded: Returns) -> dict[str, float]:
    """Compare the ranges of a decoded scan with the original, firing by firing.

    Range errors are measured where a firing has a return in both scans.

    Parameters
    ----------
    original, decoded
        Returns of a spinning sensor with the same turns (revolutions), columns and lasers.

    Returns
    -------
    dict
        * ``range_rms_mm``, ``range_max_mm``: RMS and largest range error, in mm; missing if the
          scans have no return in common.
        * ``returns_lost``: number of returns that only the original has.
        * ``returns_added``: number of returns that only the decoded scan has.

    Raises
    ------
    InputError
        The scans differ in the number of turns, columns or lasers.
    """
    pairs = list(zip(original.turns, decoded.turns, strict=False))
    if len(original.turns) != len(decoded.turns) or any(
        before.ranges.shape != after.ranges.shape for before, after in pairs
    ):
        raise InputError(
            "decoded returns: numbers of turns, columns or lasers differ from the original's"
        )
    squared, largest, count, lost, added = 0.0, 0.0, 0, 0, 0
    for before, after in pairs:
        had_return, has_return = before.ranges > 0, after.ranges > 0
        lost += int(np.count_nonzero(had_return & ~has_return))
        added += int(np.count_nonzero(has_return & ~had_return))
        in_both = had_return & has_return
        error = 1000 * (decoded.distances(after) - original.distances(before))[in_both]
        count += len(error)
        squared += float(error @ error)
        largest = max(largest, float(np.abs(error).max(initial=0.0)))
    rms = (
        {"range_rms_mm": float(np.sqrt(squared / count)), "range_max_mm": largest} if count else {}
    )
    return {**rms, "returns_lost": lost, "returns_added": added}


def decoded_range_errors(
    original: Floats, returns: Returns, decoded: PointCloud
) -> dict[str, float]:
    """Return the range errors of a decoded cloud, and the numbers of lost and added returns.

    If the cloud has returns, they are compared with `range_errors`. If the codec moved its points
    away from the returns, or if there are no returns, the errors are those of the points.

    Parameters
    ----------
    original
        Points (n, 3) of the encoded scan, in m, in sensor coordinates.
    returns
        Returns of the encoded scan.
    decoded
        The decoded cloud.

    Returns
    -------
    dict
        The values that `range_errors` describes.
    """
    if decoded.returns is None:
        return range_errors_of_points(original, decoded.xyz)
    errors = range_errors(returns, decoded.returns)
    if np.array_equal(decoded.xyz, decoded.returns.points()):
        return errors
    moved = range_errors_of_points(original, decoded.xyz)
    return errors | {name: moved[name] for name in ("range_rms_mm", "range_max_mm")}


def range_errors_of_points(original: Floats, decoded: Floats) -> dict[str, float]:
    """Return the range errors of decoded points that do not come as a sensor's returns.

    A range error is the offset, along the ray, of the decoded point that is nearest to the original
    point. Suppose that k original points have the same nearest point, and that this point was
    decoded j times. Then k - j returns are lost or, if j is larger, j - k are added.

    Parameters
    ----------
    original, decoded
        Points (n, 3) and (m, 3) in m, in sensor coordinates.

    Returns
    -------
    dict
        The values that `range_errors` describes.
    """
    from pykdtree.kdtree import KDTree

    distinct, multiplicity = np.unique(decoded, axis=0, return_counts=True)
    nearest = KDTree(distinct).query(np.ascontiguousarray(original))[1].astype(np.int64)
    length = np.linalg.norm(original, axis=1)
    along = np.einsum("ij,ij->i", distinct[nearest] - original, original)
    error = 1000 * along / np.maximum(length, 1e-9)
    queries = np.bincount(nearest, minlength=len(distinct))
    return {
        "range_rms_mm": float(np.sqrt(np.mean(error**2))),
        "range_max_mm": float(np.abs(error).max()),
        "returns_lost": int(np.maximum(queries - multiplicity, 0).sum()),
        "returns_added": int(np.maximum(multiplicity - queries, 0).sum()),
    }


def entropy_bits(
    noise: Floats, groups: NDArray[np.integer], step: float, conditions: Sequence[Floats] = ()
) -> float:
    """Return the entropy of range noise, which is the least number of bits for lossless coding.

    The mean noise of each group is subtracted first, because a codec can learn it. Miller's bias
    correction (1955) is added.

    Parameters
    ----------
    noise
        Range errors (n,), in the unit of `step`.
    groups
        Number (n,) of each value's group: one laser in one turn of the sensor.
    step
        Range resolution of the sensor.
    conditions
        Arrays (n,) from which a decoder can infer the standard deviation of the noise. The entropy
        is conditional on their octiles.

    Returns
    -------
    float
        Entropy in bits per value.
    """
    means = np.bincount(groups, noise) / np.maximum(np.bincount(groups), 1)
    levels = np.rint((noise - means[groups]) / step)
    cells = np.zeros(len(noise), np.int64)
    for values in conditions:
        edges = np.quantile(values, np.arange(1, _OCTILES) / _OCTILES)
        cells = cells * _OCTILES + np.searchsorted(edges, values)
    parts = [levels[cells == cell] for cell in np.unique(cells)]
    return sum(len(part) * _entropy_bits(part) for part in parts) / max(len(noise), 1)


def _entropy_bits(levels: Floats) -> float:
    counts = np.unique(levels, return_counts=True)[1]
    if len(counts) < 2:
        return 0.0
    shares = counts / counts.sum()
    nats = -float(shares @ np.log(shares)) + (len(counts) - 1) / (2 * len(levels))
    return nats / float(np.log(2))


def real_time_metrics(about: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, float]:
    """Return the bitrate at the sensor's speed, and coding speeds relative to the sensor.

    Parameters
    ----------
    about
        Description of the cloud, with the number of ``turns`` (revolutions) and their ``seconds``.
    row
        Results with ``bytes``, ``encode_s`` and ``decode_s``, as far as they were measured.

    Returns
    -------
    dict
        ``mbit_per_s``; ``encode_ms_per_turn`` and ``decode_ms_per_turn``; ``encode_real_time`` and
        ``decode_real_time``, which are 2 if coding is twice as fast as the sensor. It is empty if
        `about` lacks ``turns`` or ``seconds``.
    """
    turns, seconds = about.get("turns"), about.get("seconds")
    if not turns or not seconds:
        return {}
    values = {"mbit_per_s": row["bytes"] * 8e-6 / seconds} if "bytes" in row else {}
    for call in ("encode", "decode"):
        if call_s := row.get(f"{call}_s"):
            values[f"{call}_ms_per_turn"] = 1000 * call_s / turns
            values[f"{call}_real_time"] = seconds / call_s
    return values

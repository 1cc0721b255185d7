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
    """Return range errors (mm) and numbers of lost and added returns of a decoded scan.

    Errors are those of firings with returns in both scans. Raises InputError if firings differ.
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
    """Return the range errors of a decoded cloud, in mm, and the lost and added returns.

    `original` (n, 3) and `returns` are the encoded scan. A codec that moves the points of the
    decoded returns has the errors of its points.
    """
    if decoded.returns is None:
        return range_errors_of_points(original, decoded.xyz)
    errors = range_errors(returns, decoded.returns)
    if np.array_equal(decoded.xyz, decoded.returns.points()):
        return errors
    moved = range_errors_of_points(original, decoded.xyz)
    return errors | {name: moved[name] for name in ("range_rms_mm", "range_max_mm")}


def range_errors_of_points(original: Floats, decoded: Floats) -> dict[str, float]:
    """Return the metrics of `range_errors` for points (n, 3) and (m, 3) in sensor coordinates, m.

    A range error is the offset, along the ray, of the nearest decoded point. If k returns have the
    same nearest point, which was decoded j times, k - j returns are lost, or j - k added.
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
    """Return the entropy, bits per value, of noise (n,) in units of `step`: the lossless bound.

    Miller's bias correction (1955) is added. The mean noise of each of the `groups` (n,), a laser
    in a turn, is subtracted, because a codec can learn means. The entropy is conditional on octiles
    of the `conditions` (n,), from which a decoder can infer the noise's standard deviation.
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

    The result is empty if the cloud's description `about` lacks ``turns`` or ``seconds``.
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

"""Checks that encode a cloud at each rate of a codec, decode it, and compare both clouds."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from pointkit.geometry.cloud import check_points
from puckbench.checks.registry import CHECKS, Fault, LeftOut
from puckbench.checks.subject import Subject, farthest_of_both
from puckbench.codecs.rates import find_rate, parameters_of
from puckbench.metrics.cloud_metrics import geometry_metrics
from puckbench.metrics.remarks import order_remarks, remark_on

_LENGTH = "15mm"
"""A length that is not a name in a codec's `rates`, for codecs that take any length as a rate."""


@CHECKS.register(
    "round_trip",
    rank=0,
    advice="encode and decode a PointCloud at each rate, as the base class Codec says",
)
def round_trip(subject: Subject) -> str:
    """Encode and decode a cloud at each rate."""
    before = subject.cloud.xyz.copy()
    for rate, stream in subject.streams.items():
        if not np.array_equal(subject.cloud.xyz, before):
            raise Fault("encode changes the points that it gets: work on a copy")
        decoded = subject.decoded[rate]
        if stream != subject.streams[rate]:
            raise Fault(f"{rate}: decode changes the stream")
        check_points(decoded.xyz, f"{rate}: the decoded points")
    bits = [8 * len(stream) / len(subject.cloud) for stream in subject.streams.values()]
    rates = f"{len(bits)} rates" if len(bits) > 1 else "1 rate"
    span = dict.fromkeys(f"{each:.3g}" for each in (bits[0], bits[-1]))
    return f"{rates}, {' to '.join(span)} bits per point"


@CHECKS.register(
    "distances", rank=10, advice="decode points near those that were encoded, in the same unit"
)
def distances(subject: Subject) -> str:
    """Measure how far decoded points are from the original."""
    from puckbench.metrics.geometry import DistinctPoints, ReferenceCloud

    reference = ReferenceCloud(subject.cloud)
    for rate, decoded in subject.decoded.items():
        points = DistinctPoints(decoded.xyz)
        remark = remark_on(reference, points, geometry_metrics(reference, points))
        if remark and not subject.estimates:
            raise Fault(
                f"{rate}: {remark}: write step and origin into the stream, and code every point"
            )
        _check_step(subject, rate)
    error = farthest_of_both(subject.cloud.xyz, subject.decoded[subject.finest].xyz)
    unit = "grid steps" if subject.kind == "scaled" else "m"
    return f"at most {error:.3g} {unit} at {subject.finest}"


def _check_step(subject: Subject, rate: str) -> None:
    """Raise Fault if a step is all of a rate, and a point is beyond a cell's diagonal."""
    parameters = parameters_of(subject.codec, rate)
    if subject.estimates or {*parameters} != {"step_m"}:
        return
    error = farthest_of_both(subject.cloud.xyz, subject.decoded[rate].xyz)
    if error > sqrt(3) * float(parameters["step_m"]):
        raise Fault(
            f"{rate}: points are off by up to {error:.2g} m, more than the diagonal of a cell of "
            "the rate's step: quantise with `step_m` in metres"
        )


@CHECKS.register("order_of_rates", rank=20, advice="name rates so that r1 needs the fewest bits")
def order_of_rates(subject: Subject) -> str:
    """Compare bytes and errors of successive rates."""
    from puckbench.metrics.geometry import ReferenceCloud

    if len(subject.rates) < 2:
        raise LeftOut("one rate has no order")
    reference = ReferenceCloud(subject.cloud)
    rows: list[dict[str, Any]] = [
        {
            "rate": rate,
            "bytes": len(subject.streams[rate]),
            "d1_mse": geometry_metrics(reference, decoded.xyz)["d1_mse"],
        }
        for rate, decoded in subject.decoded.items()
    ]
    for row, remark in zip(rows, order_remarks(rows), strict=True):
        if remark:
            raise Fault(f"{row['rate']}: {remark}: {_ORDER}")
    sizes = [row["bytes"] for row in rows]
    if sizes[-1] <= sizes[0]:
        raise Fault(f"all rates need {sizes[0]:,} bytes: use the parameters of the rate")
    return f"{sizes[0]:,} to {sizes[-1]:,} bytes"


_ORDER = "list rates from the fewest to the most bits, and let each use its own parameters"


@CHECKS.register("any_length", rank=30, advice="look parameters up with `parameters_of`")
def any_length(subject: Subject) -> str:
    """Encode at a length that the codec does not list."""
    if subject.kind == "scaled" or find_rate(subject.codec, _LENGTH) is None:
        raise LeftOut("its rates are not lengths that users may choose")
    try:
        stream = subject.encode(subject.cloud, _LENGTH)
    except KeyError as missing:
        raise Fault(
            f"{_LENGTH}: KeyError {missing}: users may name any length, since `step_m` is the only "
            "parameter: look it up with `parameters_of(self, rate)`"
        ) from missing
    error = farthest_of_both(subject.cloud.xyz, subject.decode(stream).xyz)
    if not subject.estimates and error > sqrt(3) * 0.015:
        raise Fault(f"{_LENGTH}: points are off by up to {error:.2g} m: use `step_m`")
    return f"{_LENGTH}: {len(stream):,} bytes"

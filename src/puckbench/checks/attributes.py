"""Check of the attributes that a codec says it codes."""

from __future__ import annotations

import numpy as np

from pointkit.geometry.cloud import PointCloud
from puckbench.checks.registry import CHECKS, Fault, LeftOut
from puckbench.checks.subject import Subject
from puckbench.geometry.attributes import COLOUR, attributes_of

_MOST_ERROR = 25.0
"""Largest mean error of values from 0 to 255; they rise along an axis, so that values of a wrong
point differ by more."""


@CHECKS.register(
    "attributes", rank=120, advice="decode a PointCloud with the attributes that were coded"
)
def attributes(subject: Subject) -> str:
    """Encode a cloud with reflectances and colours, and compare what comes back."""
    named = subject.codec.attributes
    if not named:
        raise LeftOut("it names none in `attributes`")
    cloud = _with_attributes(subject)
    decoded = subject.decode(subject.encode(cloud, subject.finest))
    expected, found = attributes_of(cloud), attributes_of(decoded)
    checked = []
    for name in named:
        if name in expected:  # returns may be used by the encoder alone
            if name not in found:
                where = "`colours`" if name == COLOUR else "`fields['reflectance']`"
                raise Fault(
                    f"no {name} comes back: encode that of puckbench.geometry.attributes."
                    f"coded_attributes, and decode it to {where} of the PointCloud"
                )
            error = _mean_error((cloud, expected[name]), (decoded, found[name]))
            if error > _MOST_ERROR:
                raise Fault(
                    f"{name} is off by {error:.0f} of 255 on average: decode a value for each "
                    "point, in the order of the decoded points"
                )
            checked.append(f"{name} off by {error:.2g} on average")
    if not checked:
        raise LeftOut("it codes no reflectances and no colours of this cloud")
    return ", ".join(checked)


def _with_attributes(subject: Subject) -> PointCloud:
    if subject.kind == "returns":
        return subject.cloud
    points = subject.cloud.xyz / subject.unit
    values = np.rint(255 * (points[:, 0] - points[:, 0].min()) / np.ptp(points[:, 0]))
    colours = np.column_stack([values, 255 - values, values // 2]).astype(np.uint8)
    return subject.of(points, colours=colours, fields={"intensity": values.astype(np.uint16)})


def _mean_error(
    original: tuple[PointCloud, np.ndarray], decoded: tuple[PointCloud, np.ndarray]
) -> float:
    """Return the mean difference of decoded values from those of the nearest original points."""
    from pykdtree.kdtree import KDTree

    nearest = KDTree(original[0].xyz).query(decoded[0].xyz)[1]
    differences = decoded[1].astype(float) - original[1].astype(float)[nearest]
    return float(np.abs(differences).mean())

from __future__ import annotations

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.lidar.returns import Returns
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.rates import StepRange, parameters_of
from puckbench.geometry.attributes import REFLECTANCE, RETURNS

_NO_RETURNS = "codes the returns of a spinning sensor, and the cloud has none"
_MOST_QUANTA = 4096
"""Largest range step, in quanta, that a search for a budget of bits tries."""


class ReturnsCodec(Codec):
    """Base class of codecs that encode the returns of a spinning sensor instead of points.

    Returns are the measured ranges by turn (revolution), firing and laser. Decoded points are those
    of the decoded returns, unless `estimates` is true.
    """

    along_rays = True
    estimates = False
    """Whether decoded points are estimates of the surface, and not the points of the decoded
    returns."""

    @property
    def attributes(self) -> tuple[str, ...]:
        has_reflectance = getattr(self.options, "reflectivities", False)
        return (RETURNS, REFLECTANCE) if has_reflectance else (RETURNS,)

    def skip(self, cloud: CloudKind, rate: str) -> str | None:
        return super().skip(cloud, rate) or (None if cloud.has_returns else _NO_RETURNS)

    def step_range(self, cloud: PointCloud) -> StepRange:
        """Return the range steps of a cloud: multiples of the sensor's range unit."""
        quantum_m = returns_of(cloud).quantum_m
        return StepRange(quantum_m, _MOST_QUANTA * quantum_m, quantum_m)

    def step_in_quanta(self, returns: Returns, rate: str) -> int:
        """Return a rate's range step as a number of quanta (the sensor's range unit).

        It is rounded down, and at least 1.
        """
        step_m = float(parameters_of(self, rate)["step_m"])
        return max(1, int(step_m / returns.quantum_m + 1e-6))


def returns_of(cloud: PointCloud) -> Returns:
    """Return the returns of a cloud; raise InputError if it has none."""
    if cloud.returns is None:
        raise InputError(_NO_RETURNS)
    return cloud.returns


def cloud_of(returns: Returns) -> PointCloud:
    """Return returns as a cloud of their points, m, in the sensor's coordinate frame."""
    return PointCloud(returns.points(), returns=returns)

from __future__ import annotations

from pydantic import Field, NonNegativeFloat, PositiveFloat

from pointkit.models import Model


class OdometryMargins(Model):
    """Largest differences of odometry that count as none: fix them before you see results."""

    drift_percent: PositiveFloat = Field(
        0.1, description="Drift, in % of the way, if the true poses are known."
    )
    absolute_mm: PositiveFloat = Field(
        10.0,
        description="Absolute error of positions, in mm, if the true poses are known. It counts if "
        "a drive is too short for a drift.",
    )
    relative: NonNegativeFloat = Field(
        0.1, description="Share of the error without coding, if this is more than the margin."
    )
    deviation_drift_percent: PositiveFloat = Field(
        0.5,
        description="Drift, in %, if KISS-ICP on the undecoded turns stands for the true poses. "
        "Coded turns then deviate from a trajectory that has errors of its own: KISS-ICP drifts by "
        "0.56 % in the streets of the study.",
    )
    deviation_mm: PositiveFloat = Field(
        50.0, description="Absolute deviation of positions, in mm, from such a trajectory."
    )

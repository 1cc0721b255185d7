from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud

Attributes = Mapping[str, NDArray[Any]]
REFLECTANCE, COLOUR = "reflectance", "colour"
_MOST_REFLECTANCE = 0xFFFF
_FIELDS = (REFLECTANCE, "reflectivity", "intensity")
"""Names of reflectance fields, in order of preference."""


def attribute_of(name: str) -> str:
    """Return the attribute for which a field's name or ``colours`` stands."""
    if name.lower() in _FIELDS:
        return REFLECTANCE
    return COLOUR if name == "colours" else name


def reflectance_field(cloud: PointCloud) -> str | None:
    """Return the name of the field that holds the reflectance, or None."""
    names = {name.lower(): name for name in cloud.fields}
    return next((names[name] for name in _FIELDS if name in names), None)


def attributes_of(cloud: PointCloud) -> dict[str, NDArray[Any]]:
    """Return the reflectances (n,), from the returns or from a field, and the colours (n, 3)."""
    attributes: dict[str, NDArray[Any] | None] = {
        REFLECTANCE: None if cloud.returns is None else cloud.returns.reflectivities(),
        COLOUR: cloud.colours,
    }
    if attributes[REFLECTANCE] is None and (field := reflectance_field(cloud)):
        attributes[REFLECTANCE] = cloud.fields[field]
    return {name: values for name, values in attributes.items() if values is not None}


def check_attributes(attributes: Attributes, points: int) -> None:
    """Raise InputError unless all points have all attributes, with 16-bit integer reflectances."""
    for name, values in attributes.items():
        if len(values) != points:
            raise InputError(f"{name}: {len(values)} values for {points} points")
        if name == REFLECTANCE:
            valid = (values >= 0) & (values <= _MOST_REFLECTANCE) & (values == np.floor(values))
            if invalid := int(np.count_nonzero(~valid)):
                raise InputError(
                    f"{name}: {invalid} of {points} values are not whole numbers from 0 to "
                    f"{_MOST_REFLECTANCE}; scale and round them, or do not code them"
                )


def not_coded(cloud: PointCloud, coded: Collection[str]) -> list[str]:
    """Return the names of a cloud's attributes that are not among the `coded` ones."""
    field = reflectance_field(cloud)
    held = {name: attribute for attribute, name in ((COLOUR, "colours"), (REFLECTANCE, field))}
    names = [*(["colours"] if cloud.colours is not None else []), *cloud.fields]
    if field is None and REFLECTANCE in attributes_of(cloud):
        names.append("reflectivity")
        held["reflectivity"] = REFLECTANCE
    return [name for name in names if held.get(name) not in coded]


def cloud_with(points: Floats, attributes: Attributes) -> PointCloud:
    """Return a cloud of points (n, 3) with colours; other attributes become fields."""
    fields = {name: values for name, values in attributes.items() if name != COLOUR}
    return PointCloud(points, colours=attributes.get(COLOUR), fields=fields)

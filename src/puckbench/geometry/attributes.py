from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cloud_files.point_columns import WIDE_COLOURS
from pointkit.errors import InputError
from pointkit.geometry.cloud import Floats, PointCloud

Attributes = Mapping[str, NDArray[Any]]
REFLECTANCE, COLOUR = "reflectance", "colour"
RETURNS = "returns"
"""What a codec names among its attributes if it encodes the returns of a spinning sensor."""
OF_FILE = "file_attributes"
"""Key of a cloud's description with the names of its file's attributes (`attribute_names`)."""
_MOST_REFLECTANCE = 0xFFFF
_FIELDS = (REFLECTANCE, "reflectivity", "intensity")
"""Names of reflectance fields, in order of preference."""


def attribute_of(name: str) -> str:
    """Return the attribute that a field's name denotes.

    The names ``reflectance``, ``reflectivity`` and ``intensity`` denote `REFLECTANCE`, and
    ``colours`` denotes `COLOUR`. Any other name is returned unchanged.
    """
    if name.lower() in _FIELDS:
        return REFLECTANCE
    return COLOUR if name == "colours" else name


def attribute_names(cloud: PointCloud) -> tuple[str, ...]:
    """Return the names of all attributes of a cloud besides coordinates.

    They are ``normals``, ``colours``, ``labels`` and the names of fields. Colours of 16 bits repeat
    the colours, and are left out.
    """
    arrays = {"normals": cloud.normals, "colours": cloud.colours, "labels": cloud.labels}
    names = [name for name, values in {**arrays, **cloud.fields}.items() if values is not None]
    return tuple(name for name in names if name not in WIDE_COLOURS)


def reflectance_field(cloud: PointCloud) -> str | None:
    """Return the name of the cloud's field that holds the reflectance, or None if there is none."""
    names = {name.lower(): name for name in cloud.fields}
    return next((names[name] for name in _FIELDS if name in names), None)


def attributes_of(cloud: PointCloud) -> dict[str, NDArray[Any]]:
    """Return the reflectances and the colours of a cloud, as far as it has them.

    Returns
    -------
    dict
        `REFLECTANCE` maps to values (n,), taken from the cloud's returns or else from a field;
        `COLOUR` maps to red, green and blue (n, 3). An attribute that the cloud lacks has no key.
    """
    attributes: dict[str, NDArray[Any] | None] = {
        REFLECTANCE: None if cloud.returns is None else cloud.returns.reflectivities(),
        COLOUR: cloud.colours,
    }
    if attributes[REFLECTANCE] is None and (field := reflectance_field(cloud)):
        attributes[REFLECTANCE] = cloud.fields[field]
    return {name: values for name, values in attributes.items() if values is not None}


def check_attributes(attributes: Attributes, points: int) -> None:
    """Check that attributes can be coded with a cloud.

    Parameters
    ----------
    attributes
        Values by name of the attribute, with one row for each point.
    points
        Number of points of the cloud.

    Raises
    ------
    InputError
        An attribute has another number of values than there are points, or a reflectance is not a
        whole number from 0 to 65535.
    """
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


def coded_attributes(cloud: PointCloud, names: Collection[str]) -> dict[str, NDArray[Any]]:
    """Return the attributes of a cloud that a codec encodes.

    Parameters
    ----------
    cloud
        The cloud.
    names
        Names of the attributes that the codec can encode.

    Returns
    -------
    dict
        Values by name, in the order of `names`, for those that the cloud has.

    Raises
    ------
    InputError
        An attribute has no valid values (`check_attributes`).
    """
    held = attributes_of(cloud) if names else {}
    attributes = {name: held[name] for name in names if name in held}
    check_attributes(attributes, len(cloud))
    return attributes


def not_coded(cloud: PointCloud, coded: Collection[str]) -> list[str]:
    """Return the names of the cloud's attributes that a codec does not code.

    Parameters
    ----------
    cloud
        The cloud to be coded.
    coded
        Attributes that the codec codes, such as `REFLECTANCE` and `COLOUR`.

    Returns
    -------
    list
        Names of the cloud's other attributes: ``colours``, ``reflectivity`` (of returns), names of
        fields, and the ``normals`` and ``labels`` of the file from which it was made.
    """
    field = reflectance_field(cloud)
    held = {name: attribute for attribute, name in ((COLOUR, "colours"), (REFLECTANCE, field))}
    of_file = str(cloud.about.get(OF_FILE, "")).split(", ")
    names = [name for name in of_file if name in ("normals", "labels")]
    names += [*(["colours"] if cloud.colours is not None else []), *cloud.fields]
    if field is None and REFLECTANCE in attributes_of(cloud):
        names.append("reflectivity")
        held["reflectivity"] = REFLECTANCE
    return [name for name in names if held.get(name) not in coded]


def cloud_with(points: Floats, attributes: Attributes) -> PointCloud:
    """Create a cloud from points and attributes.

    Parameters
    ----------
    points
        Coordinates (n, 3).
    attributes
        Values by name of the attribute. `COLOUR` becomes the cloud's ``colours`` (n, 3); every
        other attribute becomes a field (n,).
    """
    fields = {name: values for name, values in attributes.items() if name != COLOUR}
    return PointCloud(points, colours=attributes.get(COLOUR), fields=fields)

"""Estimates of the time and memory that codecs take, from the table ``costs.yaml``."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from pointkit.models import Model, parsed
from pointkit.yaml_files import read_yaml
from puckbench.codecs.base import Codec
from puckbench.codecs.registry import registered_name
from puckbench.geometry.attributes import COLOUR, REFLECTANCE


class Costs(Model):
    """The estimated costs of a codec: a row of ``costs.yaml``, which explains the columns."""

    memory_mb: float
    memory_bytes: float
    base_s: float
    million_s: float
    attributes_s: float
    encoding: float

    def memory_of(self, points: int) -> int:
        """Return the estimated memory, in MB, to encode or decode a number of points."""
        return int(self.memory_mb) + int(points * self.memory_bytes) // 1_000_000

    def seconds_of(self, points: int) -> float:
        """Return the estimated time, in s, to encode and decode a number of points."""
        return self.base_s + self.million_s * points / 1_000_000


def costs_of(codec: Codec) -> Costs:
    """Return the estimated costs of a codec.

    A codec that is derived from one of puckbench's has the latter's costs. A class of the user may
    have a dict of costs, under the names of the table's columns, as its attribute ``costs``.
    """
    costs = _costs_of_class(type(codec))
    if not {REFLECTANCE, COLOUR} & {*codec.attributes}:
        return costs
    return costs.replaced(million_s=costs.million_s + costs.attributes_s)


@cache
def _costs_of_class(codec: type[Codec]) -> Costs:
    table = _table()
    costs = table["default"]
    for kind in reversed(codec.__mro__):
        costs = {**table["default"], **row} if (row := table.get(registered_name(kind))) else costs
        costs = {**costs, **vars(kind).get("costs", {})}
    return parsed(Costs, costs, f"codec {codec.__name__}: costs")


@cache
def _table() -> dict[str, dict[str, Any]]:
    table: dict[str, dict[str, Any]] = read_yaml(Path(__file__).with_suffix(".yaml"))
    return table

from __future__ import annotations

from virtual_lidar.errors.model import ErrorModel
from virtual_lidar.errors.registry import ERROR_MODELS


@ERROR_MODELS.register("none")
class NoErrors(ErrorModel):
    """Error model that changes nothing: nominal rays, and true distances."""

    title, colour = "No noise", "#666688"

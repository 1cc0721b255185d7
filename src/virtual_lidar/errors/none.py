from __future__ import annotations

from virtual_lidar.errors.model import ERROR_MODELS, ErrorModel


@ERROR_MODELS.register("none")
class NoErrors(ErrorModel):
    """Error model without errors: rays are the nominal ones, and distances the true ones."""

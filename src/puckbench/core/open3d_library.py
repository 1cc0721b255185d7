"""The one door to Open3D, which serves us ray casting, closest points and normals.

Its import loads Dash and Plotly for pictures in notebooks: 0.65 of 1.3 seconds of every process.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any

_PICTURES = "open3d.visualization.draw_plotly"


class _NoPictures(ModuleType):
    """Stands in for the module of pictures while Open3D is imported."""

    def __getattr__(self, name: str) -> None:
        return None


def open3d() -> Any:
    """Open3D itself; only its functions that draw with Plotly are not there."""
    if "open3d" in sys.modules:
        return sys.modules["open3d"]
    sys.modules[_PICTURES] = _NoPictures(_PICTURES)
    try:
        return importlib.import_module("open3d")
    finally:
        del sys.modules[_PICTURES]

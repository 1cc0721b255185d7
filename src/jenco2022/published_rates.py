from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from typing import Any

OBJECTS, ROOMS, CLEAN, NOISY = "objects", "rooms", "clean scans", "noisy scans"
"""The thesis's data sets: CAPOD, S3DIS, and scans of S3DIS without and with noise."""

_DISTANCES = ("cd_plane", "hausdorff_sq_plane")


def median_rows() -> Iterator[dict[str, Any]]:
    """Yield the thesis's medians as result rows, with roles as names of data sets and codecs.

    Only first and last rates have a ``bpp``.
    """
    import yaml

    text = files("jenco2022").joinpath("published_rates.yaml").read_text(encoding="utf-8")
    for dataset, codecs in yaml.safe_load(text).items():
        for codec, curves in codecs.items():
            names = {"dataset": dataset, "cloud": "median", "codec": codec}
            distances = list(zip(*(curves[name] for name in _DISTANCES), strict=True))
            ends = dict(zip((1, len(distances)), curves["bpp"], strict=True))
            for number, values in enumerate(distances, 1):
                numbers = {"bpp": ends.get(number), **dict(zip(_DISTANCES, values, strict=True))}
                yield {**names, "rate": f"r{number}", **numbers}

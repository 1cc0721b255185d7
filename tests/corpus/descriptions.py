"""Descriptions beside clouds, and arrays of objects, that are not what they must be."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.corpus.case import Case, content

_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\n"
    "property double z\nend_header\n1 2 3\n"
)


def _described(text: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(_PLY)
        path.with_suffix(".json").write_text(text)

    return write


def _of_objects() -> bytes:
    """An array whose elements are pickled, as programs may be."""
    stream = io.BytesIO()
    np.save(stream, np.array([[Path(), 1, 2]], dtype=object), allow_pickle=True)
    return stream.getvalue()


CASES = [
    Case("scale.ply", _described('{"size": 0, "scale": "x"}'), "cloud", line="scale is 'x', but"),
    Case("offset.ply", _described('{"size": 0, "offset": [1, 2]}'), "cloud", line="offset"),
    Case("deep.ply", _described('{"size": ' + "[" * 5000), "cloud", line="deep.json: "),
    Case("objects.npy", content(_of_objects()), "cloud", line="objects.npy: "),
]

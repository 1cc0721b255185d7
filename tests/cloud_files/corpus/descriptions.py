"""Descriptions beside clouds that are not what they must be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.corpus_case import Case

_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\n"
    "property double z\nend_header\n1 2 3\n"
)


_OURS = '"puckbench": "cloud", "size": 0'


def _described(text: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(_PLY)
        path.with_suffix(".json").write_text(text)

    return write


CASES = [
    Case("scale.ply", _described(f'{{{_OURS}, "scale": "x"}}'), "cloud", error="scale is 'x', but"),
    Case("offset.ply", _described(f'{{{_OURS}, "offset": [1, 2]}}'), "cloud", error="offset"),
    Case(
        "deep.ply",
        _described('{"size": ' + "[" * 5000),
        "cloud",
        points=[(1, 2, 3)],
        warning="deep.json beside it is not its description",
    ),
]

"""Writes the files of the corpus into a folder."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.puckbench.corpus.case import cases

folder = Path(sys.argv[1])
for case in cases():
    place = folder / Path(case.file).name
    place.parent.mkdir(parents=True, exist_ok=True)
    case.write(place)

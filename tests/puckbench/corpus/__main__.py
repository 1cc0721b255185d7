"""Writes the files of both corpora, clouds and recordings, into a folder."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.cloud_files import corpus as cloud_corpus
from tests.puckbench import corpus
from tests.support.corpus_case import cases

folder = Path(sys.argv[1])
for case in (*cases(cloud_corpus), *cases(corpus)):
    place = folder / Path(case.file).name
    place.parent.mkdir(parents=True, exist_ok=True)
    case.write(place)

"""How each codec and data set is shown: one title, colour and marker wherever it appears."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Literal

Line = Literal["-", "--", "-.", ":"]


@dataclass(frozen=True)
class Look:
    """A codec's line: title in the legend, colour (hex), marker and line style of matplotlib."""

    title: str
    colour: str
    marker: str
    line: Line = "-"


# The thesis's blue, orange, green and red in the colour-blind-safe palette of Okabe and Ito.
# Relatives of a codec (another configuration, another implementation) get its hue in another
# lightness and a broken line; every codec has its own pair of colour and marker.
CODEC_LOOKS: dict[str, Look] = {
    "draco": Look("Draco", "#0072B2", "o"),
    "gpcc": Look("G-PCC", "#E69F00", "s"),
    "pcgcv1": Look("PCGCv1", "#009E73", "^"),
    "pcgcv2": Look("PCGCv2", "#D55E00", "D"),
    "primitives": Look("Primitives", "#CC79A7", "P"),
    "sparse_octree_net": Look("Sparse octree net", "#332288", "v"),
    "draco_cli": Look("Draco (reference tool)", "#56B4E9", "h", "--"),
    "gpcc_arena": Look("G-PCC (PCC Arena)", "#8C6000", "X", "--"),
    "gpcc_dyadic": Look("G-PCC (dyadic scales)", "#F2C766", "p", "-."),
    "gpcc_lossless": Look("G-PCC (finer scales)", "#C0A030", "8", ":"),
    "tmc13": Look("TMC13 (reference tool)", "#000000", "x", ":"),
    "pcgcv1_published": Look("PCGCv1 (as published)", "#66CDAA", "<", "--"),
    "pcgcv2_published": Look("PCGCv2 (as published)", "#F0A070", "2", "--"),
    "pcgcv2_rooms": Look("PCGCv2 (rooms)", "#882255", "d", "--"),
    "geocnnv1": Look("GeoCNNv1", "#999933", ">"),
    "geocnnv2": Look("GeoCNNv2", "#661100", "*"),
    "vpcc": Look("V-PCC", "#777777", "H"),
}

_OTHER_COLOURS = ("#44AA99", "#AA4499", "#DDAA33", "#117733", "#BB5566", "#6699CC", "#5D4037")
_OTHER_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "d", "<", ">")
_OTHER_LINES: tuple[Line, ...] = (":", "--", "-.")

DATASET_TITLES: dict[str, str] = {
    "capod": "CAPOD",
    "s3dis": "S3DIS",
    "s3dis_raw": "S3DIS",
    "s3dis_clean": "S3DIS, virtual VLP-16 (no\u00a0noise)",
    "s3dis_noisy": "S3DIS, virtual VLP-16",
    "rooms_raw": "Rooms, raw",
    "rooms_clean": "Rooms, virtual VLP-16 (no\u00a0noise)",
    "rooms_noisy": "Rooms, virtual VLP-16",
}


def codec_look(codec: str) -> Look:
    """The look of a codec; one not in the table gets one from its name alone.

    So a codec looks the same in every figure, whichever others are drawn beside it.
    """
    if codec in CODEC_LOOKS:
        return CODEC_LOOKS[codec]
    digest = hashlib.sha256(codec.encode()).digest()
    return Look(
        title=codec,
        colour=_OTHER_COLOURS[digest[0] % len(_OTHER_COLOURS)],
        marker=_OTHER_MARKERS[digest[1] % len(_OTHER_MARKERS)],
        line=_OTHER_LINES[digest[2] % len(_OTHER_LINES)],
    )


def codec_rank(codec: str) -> tuple[int, str]:
    """Sorting key of codecs in legends: the table's order, then by name."""
    names = list(CODEC_LOOKS)
    return (names.index(codec) if codec in CODEC_LOOKS else len(names), codec)


def dataset_title(dataset: str) -> str:
    """The title of a data set; one not in the table is called by its name in words."""
    words = dataset.replace("_", " ")
    return DATASET_TITLES.get(dataset, words[:1].upper() + words[1:])

"""The page's own style and scripts: plain files, which the page holds as they are."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from importlib.resources import files

STYLE = "page.css"
SCRIPTS = (
    "dom.js",
    "tables.js",
    "axes.js",
    "markers.js",
    "plot.js",
    "camera.js",
    "drawing.js",
    "viewer.js",
    "page.js",
)


def asset(name: str) -> str:
    """The text of a file of ours."""
    return files("puckbench.report").joinpath("assets", name).read_text(encoding="utf-8")


def script_hash(text: str) -> str:
    """What a content security policy calls an inline script by."""
    return "sha256-" + b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")


def assets_version() -> str:
    """Fingerprint of style and scripts, for what is made again when they change."""
    text = "".join(asset(name) for name in (STYLE, *SCRIPTS))
    return hashlib.sha256(text.encode()).hexdigest()[:16]

from __future__ import annotations

import re
import unicodedata
from itertools import filterfalse


def decoded(name: bytes) -> str:
    """Decode a name in UTF-8, or else in the usual encoding of Windows."""
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")


def ascii_name(name: str) -> str:
    """Return a name as PLY permits: letters without accents, digits and underscores."""
    letters = filterfalse(unicodedata.combining, unicodedata.normalize("NFKD", name))
    return re.sub(r"\W+", "_", "".join(letters), flags=re.ASCII)

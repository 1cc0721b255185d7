from __future__ import annotations

import re
import unicodedata
from itertools import filterfalse


def decoded(name: bytes) -> str:
    """Return the text of an encoded field name.

    A name that is not valid UTF-8 is decoded as Windows-1252, the usual encoding of Windows in
    Western Europe; bytes that are invalid there, too, become U+FFFD.
    """
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")


def ascii_name(name: str) -> str:
    """Return a name as PLY permits: letters without accents, digits and underscores."""
    letters = filterfalse(unicodedata.combining, unicodedata.normalize("NFKD", name))
    return re.sub(r"\W+", "_", "".join(letters), flags=re.ASCII)

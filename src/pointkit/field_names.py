"""Names of fields in files: their encoding, and their form in PLY."""

from __future__ import annotations

import re
import unicodedata
from itertools import filterfalse


def decoded(name: bytes) -> str:
    """Return the name of a field as text.

    A name that is not valid UTF-8 is decoded as Windows-1252, the usual encoding of Windows in
    Western Europe; bytes that are invalid there, too, become U+FFFD (the replacement character).
    """
    try:
        return name.decode()
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")


def ascii_name(name: str) -> str:
    """Return a name in the form that PLY permits.

    Letters lose their accents, and all characters but letters, digits and underscores become
    underscores.
    """
    letters = filterfalse(unicodedata.combining, unicodedata.normalize("NFKD", name))
    return re.sub(r"\W+", "_", "".join(letters), flags=re.ASCII)

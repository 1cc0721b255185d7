from __future__ import annotations

from pathlib import Path

from pointkit.files import sha256

_DIGITS = 16


def weights_label(path: Path | None) -> str:
    """Return the name of a weights file, and the first digits of its digest, after a space.

    The digest is the one in the file's header or, without a header, the file's SHA-256. Without a
    file, the text is empty.
    """
    if path is None:
        return ""
    from pcc_networks.catalogue import SUFFIX, header_of

    kept = header_of(path).digest if path.suffix == SUFFIX else None
    return f"{path.stem} {kept or sha256(path)[:_DIGITS]}"

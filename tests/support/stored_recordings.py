from __future__ import annotations

from pathlib import Path

from puck import CodingOptions, compress, decompress
from puck.recording import RecordingSummary


def there_and_back(
    folder: Path, data: bytes, settings: CodingOptions | None = None
) -> RecordingSummary:
    """Compress and decompress bytes; what was in them."""
    (folder / "recording").write_bytes(data)
    account = compress(folder / "recording", folder / "small.puck", settings)
    restored = decompress(folder / "small.puck", folder / "back")
    assert (folder / "back").read_bytes() == data
    assert account.compressed == (folder / "small.puck").stat().st_size
    assert (account.clouds, account.points) == (restored.clouds, restored.points)
    return account

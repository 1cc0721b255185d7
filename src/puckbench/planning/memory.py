from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from pointkit.files import read_object, write_json


class Memory:
    """What planning has learned of input files, in JSON files that the next run reads instead.

    Planning itself writes no file: `save` does, when a run begins.

    Parameters
    ----------
    folder
        Folder of the JSON files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._learned: dict[str, dict[str, Any]] = {}

    def read(self, name: str) -> dict[str, Any]:
        """Return what is known under a name; it is empty if the file is missing or damaged.

        `name` is the path of the JSON file in the folder.
        """
        if name in self._learned:
            return self._learned[name]
        with suppress(InputError):
            return read_object(self._folder / name)
        return {}

    def learn(self, name: str, values: dict[str, Any]) -> None:
        """Keep values under a name, in place of what was known."""
        self._learned[name] = values

    def save(self) -> None:
        """Write what was learned, as far as the folder can be written."""
        for name, values in self._learned.items():
            with suppress(InputError):  # nothing is lost: the next run reads the input files again
                write_json(self._folder / name, values)

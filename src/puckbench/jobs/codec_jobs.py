from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import Field, PrivateAttr

from pointkit.errors import InputError
from pointkit.registry import is_place
from puckbench.codecs.base import Codec
from puckbench.codecs.registry import codec_of, is_codec, open_codec
from puckbench.jobs.curve_files import Coded
from puckbench.jobs.registry import Job

CODE = ("puckbench.core.archives", "puckbench.codecs.base", "puckbench.jobs.curve_files")


class CodecJob(Job):
    """A job that uses a codec; `changes` is the codec's entry in the configuration."""

    codec: str | None = None
    changes: dict[str, Any] = Field({})
    _loaded: dict[str, Codec] = PrivateAttr(default_factory=dict)

    def plugins(self) -> Iterable[str | None]:
        yield from codec_plugins(self.codec, self.changes)

    def loaded(self, name: str) -> Codec:
        if name not in self._loaded:
            self._loaded[name] = ready(open_codec(name, self.changes))
        return self._loaded[name]

    def codec_of(self, coded: Coded) -> str:
        """Return the name of a stream's codec.

        The name comes from the job's settings, else from the magic bytes, else from the record.
        Raises InputError if there is no name, or the record's codec is not registered.
        """
        if self.codec:
            return self.codec
        try:
            return codec_of(coded.stream)
        except InputError:
            if "codec" not in coded.record:
                raise
            name = str(coded.record["codec"])
        if not is_codec(name) and "class" not in self.changes:
            code = repr(name) if is_place(name) else "path/to/file.py:Class"
            raise InputError(f"codec {name!r} is not registered: name its code with --codec {code}")
        return name


class TimedJob(CodecJob):
    """A job with timed calls; `alone` is true if no other job runs at the same time."""

    repeats: int = 1
    alone: bool = False

    def runs_twice(self, codec: Codec) -> bool:
        """Return whether to run a codec twice and compare results: only for the user's codecs."""
        return self.repeats == 1 and not type(codec).__module__.startswith("puckbench.")


def ready(codec: Codec) -> Codec:
    """Load weights and compiled loops; raise InputError if the codec cannot run here."""
    ok, why = codec.available()
    if not ok:
        raise InputError(f"codec {codec.name} cannot run here: {why}")
    codec.load()
    return codec


def codec_plugins(name: str | None, changes: Mapping[str, Any]) -> Iterable[str | None]:
    return name, changes.get("class"), changes.get("training")


def with_options(changes: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    return {**changes, "options": {**changes.get("options", {}), **more}}

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import Field, PrivateAttr

from pointkit.errors import InputError
from pointkit.registry import is_place
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.registry import codec_of, is_codec, open_codec
from puckbench.jobs.curve_files import Coded
from puckbench.jobs.registry import Job

CODE = ("puckbench.core.archives", "puckbench.codecs.base", "puckbench.jobs.curve_files")


class CodecJob(Job):
    """Base class of jobs that use codecs.

    Parameters
    ----------
    codec
        Name of the codec. With None, each stream determines the codec that decodes it.
    changes
        The codec's entry in the configuration: changes to its options and rates.
    """

    codec: str | None = None
    changes: dict[str, Any] = Field({})
    _loaded: dict[str, Codec] = PrivateAttr(default_factory=dict)

    def plugins(self) -> Iterable[str | None]:
        yield from codec_plugins(self.codec, self.changes)

    def loaded(self, name: str) -> Codec:
        """Return a codec that is ready to code; raise InputError if it cannot run here."""
        if name not in self._loaded:
            self._loaded[name] = ready(open_codec(name, self.changes))
        return self._loaded[name]

    def codec_of(self, coded: Coded) -> str:
        """Return the name of the codec that decodes a stream.

        It is the codec of the job's settings. If they name none, it is the codec that the first
        bytes of the stream identify, or finally the codec named in the stream's record.

        Raises
        ------
        InputError
            None of these names a codec, or the codec in the record is not registered.
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
    """Base class of jobs that measure the time of encoding or decoding.

    Parameters
    ----------
    repeats
        Number of times that each call is repeated; the median time counts.
    alone
        Whether no other job runs at the same time. This is noted with the results.
    """

    repeats: int = 1
    alone: bool = False

    def runs_twice(self, codec: Codec) -> bool:
        """Return whether to call a codec once more, to check that results are the same.

        This is done for the user's codecs only, and only if timing does not repeat calls anyway.
        """
        return self.repeats == 1 and not type(codec).__module__.startswith("puckbench.")


def ready(codec: Codec) -> Codec:
    """Return a codec after it has loaded its weights and compiled its loops.

    Raises InputError if the codec cannot run on this machine.
    """
    if why := why_not_here(codec):
        raise InputError(f"codec {codec.name} cannot run here: {why}")
    codec.load()
    return codec


def codec_plugins(name: str | None, changes: Mapping[str, Any]) -> Iterable[str | None]:
    """Return the names or places of the plug-ins of a codec with this entry."""
    return name, changes.get("class"), changes.get("training")


def with_options(changes: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return a codec's entry of the configuration with some options added or replaced."""
    return {**changes, "options": {**changes.get("options", {}), **more}}

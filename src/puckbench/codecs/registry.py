"""The codecs by name: puckbench's own, those of installed packages, and a user's own files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.codecs.base import Codec, Pace
from puckbench.coding.shift import unshifted
from puckbench.coding.unit import without_unit
from puckbench.core.errors import InputError
from puckbench.core.models import among, parsed
from puckbench.core.registry import Registry, load, trust

if TYPE_CHECKING:
    from puckbench.learned.training.settings import Training

Entry = Mapping[str, Any]

CODECS: Registry[type[Codec]] = Registry("codec", "codecs")
"""Every codec is registered here, above its class: ``@CODECS.register("name")``."""


def codecs() -> dict[str, type[Codec]]:
    """The codecs of puckbench and of installed packages by name, in the order of their ranks."""
    found = {name: CODECS.get(name) for name in CODECS.names()}
    return dict(sorted(found.items(), key=lambda item: (item[1].rank, item[0])))


def codec_class(name: str, changes: Entry | None = None) -> type[Codec]:
    """The class of a codec; InputError when there is none.

    Parameters
    ----------
    name
        Of a codec, or ``module:Class`` or ``path/to/file.py:Class`` that is trusted
        (`puckbench.core.registry.trust`).
    changes
        A configuration's entry for it, which may name another ``class``.
    """
    place = (changes or {}).get("class")
    found = CODECS.get(name) if place is None else load(place, f"codec {name}")
    if not (isinstance(found, type) and issubclass(found, Codec)):
        raise InputError(f"codec {name}: {found!r} is not a class derived from Codec")
    trust([found.training])  # code that runs may name more code
    return found


def entry(name: str, changes: Entry | None = None) -> dict[str, Any]:
    """The class, options and rates of a codec, complete and checked.

    Parameters
    ----------
    name
        Of the codec.
    changes
        What a configuration says of it: ``options``, ``rates`` and ``metric_rates`` (names of those
        to keep, or a table of others) and, for a codec of one's own, ``class`` (``module:Class`` or
        ``file.py:Class``).

    Raises
    ------
    InputError
        The codec, an option or a rate is unknown, or the codec has no rates.
    """
    codec, changes = open_codec(name, changes), changes or {}
    place = changes.get("class") or f"{CODECS.module_of(name)}:{type(codec).__name__}"
    trust([place])  # that of a class that is loaded already
    options = {**changes.get("options", {}), **codec.options.model_dump()}
    found = {"class": place, "options": options, "rates": dict(codec.rates)}
    return {**found, **({"metric_rates": codec.metric_rates} if codec.metric_rates else {})}


def entries() -> dict[str, dict[str, Any]]:
    """The entries of the codecs that are known by name."""
    return {name: entry(name) for name in codecs()}


def open_codec(name: str, changes: Entry | None = None) -> Codec:
    """The codec of a name with a configuration's changes, as `entry` reads them."""
    own_class, changes = codec_class(name, changes), changes or {}
    own = {"rates": own_class.rates, "metric_rates": own_class.metric_rates}
    rates = {key: _rates(name, known, changes.get(key)) for key, known in own.items()}
    if not any(rates.values()):
        raise InputError(f"codec {name}: neither its entry nor its class names rates")
    if not rates["metric_rates"]:
        del rates["metric_rates"]  # older classes do not take them
    try:
        return own_class(name=name, **rates, **changes.get("options", {}))
    except TypeError as error:
        raise InputError(f"codec {name}: {error}") from error


def _rates(name: str, known: Entry, wanted: Entry | Sequence[str] | None) -> dict[str, Any]:
    """The rates wanted of those that the class has, or instead of them."""
    if isinstance(wanted, Mapping):
        return dict(wanted)
    unknown = [rate for rate in wanted or () if rate not in known]
    if unknown:
        raise InputError(f"codec {name}: unknown rate '{unknown[0]}'{among(unknown[0], known)}")
    return {rate: values for rate, values in known.items() if wanted is None or rate in wanted}


def codes_surfaces(name: str, changes: Entry | None = None) -> bool:
    """Whether a codec's `decode_mesh` gives labelled primitives."""
    return bool((changes or {}).get("surfaces", codec_class(name, changes).surfaces))


def training_class(name: str, changes: Entry | None = None) -> str:
    """``module:Class`` of the settings of a codec's training; InputError if it cannot learn."""
    found = _training(name, changes)
    if not found:
        known = ", ".join(other for other in codecs() if has_weights(other))
        raise InputError(f"codec {name}: there is nothing to train (trainable: {known})")
    return found


def open_training(
    codec: str, entry: Mapping[str, Any] | None, settings: Mapping[str, Any]
) -> Training:
    """The training of a codec.

    Parameters
    ----------
    codec
        Name of the codec.
    entry
        A user's changes to the codec's entry.
    settings
        Options of the training by name.

    Raises
    ------
    InputError
        The codec has no training, or an option is unknown or out of range.
    """
    training: type[Training] = load(training_class(codec, entry), f"codec {codec}")
    return parsed(training, settings, f"codec {codec}: training")


def has_weights(name: str, changes: Entry | None = None) -> bool:
    """Whether a codec has trained weights, in its option `weights`: then it names its training."""
    return bool(_training(name, changes))


def _training(name: str, changes: Entry | None) -> str:
    return str((changes or {}).get("training", codec_class(name, changes).training))


def weights_files(name: str, changes: Entry | None = None) -> list[Path]:
    """The files of a codec's weights, for the fingerprint of its streams; InputError if missing."""
    return open_codec(name, changes).weights_files()


def memory_mb(name: str, points: int, changes: Entry | None = None) -> int:
    """Estimate of the memory in MB that a codec takes for a number of points."""
    return codec_class(name, changes).memory.of(points)


def pace(name: str, changes: Entry | None = None) -> Pace:
    """Estimate of the time that a codec takes."""
    return codec_class(name, changes).pace


def codec_of(stream: bytes) -> str:
    """Name of the first codec by rank whose magic the stream begins with; else InputError."""
    stream = without_unit(unshifted(stream).stream).stream
    for name, found in codecs().items():
        if found.magic and stream.startswith(found.magic):
            return name
    for name, found in codecs().items():
        if found.bare_magic and stream.startswith(found.bare_magic):
            raise InputError(f"if it is a bare stream of {found.title}, say so (--codec {name})")
    raise InputError("no known codec recognises the stream: name its codec (--codec)")


def module_of(class_name: str) -> str:
    """The module (or file) that holds a codec's class, for the fingerprint of its code."""
    return class_name.rpartition(":")[0]

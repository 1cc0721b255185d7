"""The table of codecs (codecs.yaml, installed packages', a user's own) and how to open one."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from importlib.resources import files
from typing import Any

import yaml

from puckbench.codecs.base import Codec
from puckbench.core.errors import InputError
from puckbench.core.plugins import load_class

Entry = Mapping[str, Any]
GROUP = "puckbench.codecs"
"""Entry points of packages that bring codecs: name of the codec to its class."""


@cache
def entries() -> dict[str, Entry]:
    """The shipped codecs: name to entry (class, magic, options, rates)."""
    text = files("puckbench.codecs").joinpath("codecs.yaml").read_text(encoding="utf-8")
    table: dict[str, Entry] = yaml.safe_load(text)
    return table


def installed() -> dict[str, str]:
    """The codecs that other installed packages bring: name to class."""
    return {point.name: point.value for point in entry_points(group=GROUP)}


def entry(name: str, changes: Entry | None = None) -> dict[str, Any]:
    """The entry of a codec with a user's changes: options, a choice of rates, or a new codec.

    `changes` may hold ``options`` (added to the shipped ones), ``rates`` (a list of names to keep,
    or a table of new ones) and, for a codec of one's own, ``class`` (``module:Class`` or
    ``path/to/file.py:Class``); `codes_surfaces` reads one more. InputError for an unknown codec or
    rate, and for a codec without any rate.
    """
    changes = changes or {}
    base = entries().get(name, {})
    own_class = changes.get("class") or base.get("class") or installed().get(name)
    if own_class is None:
        known = ", ".join([*entries(), *installed()])
        raise InputError(f"unknown codec '{name}' (known: {known})")
    return {
        "class": own_class,
        "options": {**base.get("options", {}), **changes.get("options", {})},
        "rates": _rates(name, base.get("rates", own_class), changes.get("rates")),
    }


def codes_surfaces(name: str, changes: Entry | None = None) -> bool:
    """Whether a codec's `decode_mesh` gives labelled primitives: ``surfaces`` in its entry."""
    shipped = entries().get(name, {}).get("surfaces", False)
    return bool((changes or {}).get("surfaces", shipped))


def _rates(name: str, shipped: Entry | str, wanted: Any) -> dict[str, Any]:
    """The rates wanted of those shipped, or of those that the class named instead has."""
    if isinstance(wanted, Mapping):
        return dict(wanted)
    known = _rates_of(name, shipped) if isinstance(shipped, str) else shipped
    if wanted is None:
        return dict(known)
    unknown = [rate for rate in wanted if rate not in known]
    if unknown:
        raise InputError(f"codec {name}: unknown rate '{unknown[0]}' (known: {', '.join(known)})")
    return {rate: values for rate, values in known.items() if rate in wanted}


def _rates_of(name: str, class_name: str) -> Entry:
    rates: Entry = load_class(class_name, f"codec {name}").rates
    if not rates:
        raise InputError(f"codec {name}: neither its entry nor its class names rates")
    return rates


def open_codec(name: str, changes: Entry | None = None) -> Codec:
    """The codec of an entry; InputError when its class or an option is unknown."""
    found = entry(name, changes)
    codec_class = load_class(found["class"], f"codec {name}")
    try:
        codec: Codec = codec_class(name=name, rates=found["rates"], **found["options"])
    except TypeError as error:
        raise InputError(f"codec {name}: {error}") from error
    return codec


def training_class(name: str, changes: Entry | None = None) -> str:
    """Where the settings of a codec's training are; InputError for a codec that cannot learn."""
    if not has_weights(name, changes):
        known = ", ".join(name for name in entries() if has_weights(name))
        raise InputError(f"codec {name}: there is nothing to train (trainable: {known})")
    return str({**entries().get(name, {}), **(changes or {})}["training"])


def has_weights(name: str, changes: Entry | None = None) -> bool:
    """Whether a codec has trained weights, in its option `weights`: then it names its training."""
    return "training" in {**entries().get(name, {}), **(changes or {})}


def codec_of(stream: bytes) -> str:
    """Name of the first shipped codec whose magic the stream begins with; else InputError."""
    for name, found in entries().items():
        if stream.startswith(found["magic"].encode("latin-1")):
            return name
    raise InputError("no shipped codec recognises the stream")


def module_of(class_name: str) -> str:
    """The module (or file) that holds a codec's class, for the fingerprint of its code."""
    return class_name.rpartition(":")[0]

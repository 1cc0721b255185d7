"""The registry of codecs, which opens them by name.

It contains the codecs of puckbench and of installed packages, and opens those in files of the user.
A variant is a codec under another name, with changed options, rates or plot style. Variants are
defined in ``variants.yaml`` beside this module, or in a configuration.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import create_model

from pointkit.errors import InputError, among, naming
from pointkit.models import Model, parsed
from pointkit.registry import Registry, is_place, load, trust
from pointkit.yaml_files import read_yaml
from puckbench.codecs.base import Codec
from puckbench.codecs.facts import find_rate
from puckbench.codecs.shift import unshifted
from puckbench.codecs.unit import without_unit

if TYPE_CHECKING:
    from pcc_networks.training.settings import BaseTraining

Entry = Mapping[str, Any]
"""What a configuration says about a codec: class, options, rates, metric_rates, and `LOOKS`."""
LOOKS = ("title", "use", "colour", "marker", "line", "rank")
"""Class attributes that lists and figures show. An entry of a configuration may change them."""

CODECS: Registry[type[Codec]] = Registry("codec", "codecs")
"""Registry of codec classes. ``@CODECS.register("name")`` above a class registers it."""


@cache
def variants() -> dict[str, Entry]:
    """Return puckbench's variants of its codecs: the entries of ``variants.yaml`` by name."""
    entries: dict[str, Entry] = read_yaml(Path(__file__).with_name("variants.yaml"))
    return entries


def codecs() -> dict[str, type[Codec]]:
    """Return the classes of all codecs and variants by name, sorted by `rank`."""
    classes = {name: codec_class(name) for name in (*CODECS.names(), *variants())}
    return dict(sorted(classes.items(), key=lambda item: (item[1].rank, item[0])))


def is_codec(name: str) -> bool:
    """Return whether puckbench or an installed package has a codec with this name."""
    return name in variants() or name in CODECS


def codec_class(name: str, entry: Entry | None = None) -> type[Codec]:
    """Return the class of a codec.

    Parameters
    ----------
    name
        Name of the codec, ``module:Class`` or ``path/to/file.py:Class``. The latter two must be
        trusted (see `pointkit.registry.trust`).
    entry
        What a configuration says about the codec. Its ``class`` may name another codec or
        ``module:Class``.

    Raises
    ------
    InputError
        There is no such codec.
    """
    entry = entry or {}
    base = entry.get("class") or name
    if base in variants():
        codec = _variant(base)
    elif base in CODECS:
        codec = CODECS.get(base)
    elif is_place(base):
        codec = load(base, f"codec {name}")
    else:
        raise InputError(f"unknown codec '{base}'{among(base, codecs())}")
    if not (isinstance(codec, type) and issubclass(codec, Codec)):
        raise InputError(f"codec {name}: {codec!r} is not a class derived from Codec")
    trust([codec.training])  # trusted code may name other code
    return _with_looks(codec, entry)


def _with_looks(codec: type[Codec], entry: Entry) -> type[Codec]:
    """Return a subclass with the plot style of an entry, or `codec` itself if there is none."""
    looks = {key: entry[key] for key in LOOKS if entry.get(key) is not None}
    return _derived(codec, looks) if looks else codec


def _derived(codec: type[Codec], attributes: Entry) -> type[Codec]:
    derived: type[Codec] = type(
        codec.__name__, (codec,), {"__module__": codec.__module__, **attributes}
    )
    return derived


@cache
def _variant(name: str) -> type[Codec]:
    entry = variants()[name]
    base = codec_class(name, {"class": entry["class"]})
    rates = {key: entry[key] for key in ("rates", "metric_rates") if key in entry}
    options = _with_defaults(base.Options, entry.get("options", {}))
    about = {"__doc__": entry["what"], "Options": options, **rates}
    return _with_looks(_derived(base, about), entry)


def _with_defaults(options: type[Model], defaults: Entry) -> type[Model]:
    fields: dict[str, Any] = {}
    for name, default in defaults.items():
        field = copy.copy(options.model_fields[name])
        field.default = default
        fields[name] = (field.annotation, field)
    return create_model(options.__name__, __base__=options, **fields) if fields else options


def entry(name: str, changes: Entry | None = None) -> dict[str, Any]:
    """Return the complete and checked configuration of a codec.

    Parameters
    ----------
    name
        Name of the codec, as in `codec_class`.
    changes
        What a configuration says about the codec: ``class``, ``options``, ``rates`` and
        ``metric_rates``. Each of the last two is a list of rate names to keep, or a dict of
        parameters by name.

    Returns
    -------
    dict
        ``class`` (where it is defined), ``options`` and ``rates`` and, if there are any,
        ``metric_rates``; all with defaults filled in.

    Raises
    ------
    InputError
        The codec, an option or a rate is unknown, or the codec has no rates.
    """
    codec, changes = open_codec(name, changes), changes or {}
    place = place_of(name, changes)
    trust([place])  # the place of a class that is already loaded
    options = {**changes.get("options", {}), **codec.options.model_dump()}
    complete = {"class": place, "options": options, "rates": dict(codec.rates)}
    if codec.metric_rates:
        complete["metric_rates"] = codec.metric_rates
    return complete


def place_of(name: str, changes: Entry | None = None) -> str:
    """Return where a codec's class is defined, as ``module:Class`` or ``file.py:Class``.

    The arguments are those of `entry`.
    """
    base = (changes or {}).get("class") or name
    base = variants().get(base, {}).get("class", base)
    if base not in CODECS:
        return str(base)
    return f"{CODECS.module_of(base)}:{CODECS.get(base).__name__}"


def open_codec(name: str, changes: Entry | None = None) -> Codec:
    """Create a codec.

    Parameters
    ----------
    name
        Name of the codec, as in `codec_class`.
    changes
        What a configuration says about the codec, as in `entry`.

    Raises
    ------
    InputError
        The codec, an option or a rate is unknown, or the codec has no rates.
    """
    codec, changes = codec_class(name, changes), changes or {}
    with naming(f"codec {name}"):
        rates = _rates(codec, changes)
    if not any(rates.values()):
        raise InputError(f"codec {name}: neither its entry nor its class names rates")
    if not rates["metric_rates"]:
        del rates["metric_rates"]  # a user's class may lack the parameter
    try:
        return codec(name=name, **rates, **changes.get("options", {}))
    except KeyError as error:
        raise InputError(f"codec {name}: a rate lacks the parameter {error}") from error
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"codec {name}: {error}") from error


def _rates(codec: type[Codec], changes: Entry) -> dict[str, dict[str, Any]]:
    """Return the parameters of the rates that an entry requests, under "rates" and "metric_rates".

    Under each of these keys, an entry has a dict of parameters by rate name, or a list of rate
    names. By default, all rates are returned. The list under "rates" may include lengths.
    """
    tables: dict[str, Entry] = {"rates": codec.rates, "metric_rates": codec.metric_rates}
    requested = {key: changes[key] for key in tables if changes.get(key) is not None}
    names = requested.get("rates", ())
    if not isinstance(names, Mapping):
        lengths = [rate for rate in names if rate not in codec.rates and find_rate(codec, rate)]
        if lengths:
            requested["rates"] = [rate for rate in names if rate not in lengths]
            requested["metric_rates"] = [*requested.get("metric_rates", ()), *lengths]
    return {
        key: _selected(codec, table, requested.get(key, table)) for key, table in tables.items()
    }


def _selected(
    codec: type[Codec], offered: Entry, requested: Entry | Sequence[str]
) -> dict[str, Any]:
    if isinstance(requested, Mapping):
        return dict(requested)
    selected = {}
    for rate in requested:
        name, parameters = find_rate(codec, rate) or (rate, None)
        if parameters is None or (name not in offered and name in codec.rates):
            raise InputError(f"unknown rate '{rate}'{among(rate, offered)}")
        selected[name] = parameters
    if selected.keys() <= offered.keys():
        return {name: offered[name] for name in offered if name in selected}
    return dict(sorted(selected.items(), key=lambda item: -item[1]["step_m"]))


def codes_surfaces(name: str, changes: Entry | None = None) -> bool:
    """Return whether a codec decodes a mesh with labelled primitives (see `Codec.decode_mesh`).

    The arguments are those of `entry`.
    """
    return bool((changes or {}).get("surfaces", codec_class(name, changes).surfaces))


def training_class(name: str, changes: Entry | None = None) -> str:
    """Return the class of a codec's training settings as ``module:Class``.

    Raises InputError if the codec cannot be trained.
    """
    place = _training(name, changes)
    if not place:
        trainable = ", ".join(other for other in codecs() if has_weights(other))
        raise InputError(f"codec {name}: there is nothing to train (trainable: {trainable})")
    return place


def open_training(codec: str, changes: Entry | None, settings: Entry) -> BaseTraining:
    """Create the training settings of a codec.

    Parameters
    ----------
    codec
        Name of the codec.
    changes
        What a configuration says about the codec, as in `entry`.
    settings
        Values of the settings by name.

    Raises
    ------
    InputError
        The codec cannot be trained, or a setting is invalid.
    """
    training: type[BaseTraining] = load(training_class(codec, changes), f"codec {codec}")
    return parsed(training, settings, f"codec {codec}: training")


def has_weights(name: str, changes: Entry | None = None) -> bool:
    """Return whether a codec can be trained, and therefore has the option `weights`."""
    return bool(_training(name, changes))


def _training(name: str, changes: Entry | None) -> str:
    return str((changes or {}).get("training", codec_class(name, changes).training))


def codec_of(stream: bytes) -> str:
    """Return the name of the codec that made a stream, found by the stream's first bytes (magic).

    If several codecs match, the one with the lowest rank is returned. Raises InputError if none
    matches.
    """
    stream = unshifted(without_unit(unshifted(stream).stream).stream).stream
    for name, codec in codecs().items():
        if codec.magic and stream.startswith(codec.magic):
            return name
    for name, codec in codecs().items():
        if codec.bare_magic and stream.startswith(codec.bare_magic):
            raise InputError(
                f"the stream may be a bare one of {codec.title}: name the codec (--codec {name})"
            )
    raise InputError("no codec recognises the stream: name its codec (--codec)")


def module_of(place: str) -> str:
    """Return the name of the module that defines a codec's class."""
    return place.rpartition(":")[0]

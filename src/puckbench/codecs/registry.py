"""The registry of codecs, which opens them by name.

It contains the codecs of puckbench and of installed packages, and opens those in files of the user.
A variant is a codec under another name, with changed options, rates or plot style. Variants are
defined in ``variants.yaml`` beside this module, or in a configuration. Plot styles of codecs are
defined in ``styles.yaml``.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import create_model

from pointkit.errors import InputError, among, naming
from pointkit.models import Model, parsed
from pointkit.registry import Registry, is_place, load, trust
from pointkit.yaml_files import read_yaml
from puckbench.codecs.base import Codec
from puckbench.codecs.old_contract import adapted
from puckbench.codecs.rates import (
    Parameters,
    budget_of,
    budgets_among,
    budgets_of,
    check_metric,
    find_rate,
    metric_rates,
    scaled_rates,
    set_budgets,
)
from puckbench.codecs.shift import unshifted
from puckbench.codecs.unit import without_unit
from puckbench.geometry.attributes import COLOUR, REFLECTANCE, RETURNS

if TYPE_CHECKING:
    from pcc_networks.training.settings import BaseTraining

Entry = Mapping[str, Any]
"""What a configuration says about a codec: class, options, rates, metric_rates, and `Look`."""
Line = Literal["-", "--", "-.", ":"]


class Look(NamedTuple):
    """How lists and figures show a codec.

    Parameters
    ----------
    title
        Title in legends; by default, the name of the codec is used.
    use
        A few words on what the codec is good for.
    colour
        Colour of its curves as ``#rrggbb``; by default, it is derived from the name.
    marker
        Matplotlib marker on its curves; by default, it is derived from the name.
    line
        Style of its lines.
    rank
        Position in legends and lists; codecs of equal rank are ordered by name.
    """

    title: str = ""
    use: str = ""
    colour: str = ""
    marker: str = ""
    line: Line = "-"
    rank: int = 1000


_BARE_GPCC = b"\0\0\0"
"""First bytes of G-PCC streams without puckbench's wrapper."""

CODECS: Registry[type[Codec]] = Registry("codec", "codecs")
"""Registry of codec classes. ``@CODECS.register("name")`` above a class registers it."""


@cache
def variants() -> dict[str, Entry]:
    """Return puckbench's variants of its codecs: the entries of ``variants.yaml`` by name."""
    entries: dict[str, Entry] = read_yaml(Path(__file__).with_name("variants.yaml"))
    return entries


@cache
def _styles() -> dict[str, Entry]:
    styles: dict[str, Entry] = read_yaml(Path(__file__).with_name("styles.yaml"))
    return styles


def codecs() -> dict[str, type[Codec]]:
    """Return the classes of all codecs and variants by name, sorted by the rank of their looks."""
    names = sorted((*CODECS.names(), *variants()), key=lambda name: (look(name).rank, name))
    return {name: codec_class(name) for name in names}


def look(name: str, entry: Entry | None = None) -> Look:
    """Return how lists and figures show a codec.

    The keys of `Look` are taken from the codec's entry, from a variant, and then from the codec's
    class and those from which it is derived: codecs of puckbench have them in ``styles.yaml``,
    others as attributes of the class. The arguments are those of `codec_class`.
    """
    entry = entry or {}
    sources = [entry, variants().get(entry.get("class") or name, {})]
    sources += _class_styles(codec_class(name, entry))
    keys = {
        key: source[key]
        for source in reversed(sources)
        for key in Look._fields
        if isinstance(source.get(key), str | int)
    }
    return Look(**keys)


def _class_styles(codec: type[Codec]) -> list[Entry]:
    """Return the places that may define a class's style, as dictionaries by name of the property.

    They are the attributes of the class and of each base class and, last, the entry of the class
    (or of the nearest base class that has one) in ``styles.yaml``.
    """
    names = (registered_name(kind) for kind in codec.__mro__)
    named = (_styles()[name] for name in names if name in _styles())
    return [*map(vars, codec.__mro__), next(named, {})]


def based_on(codec: Codec) -> str:
    """Return the name of the published codec that a codec modifies, or "" if it modifies none.

    If a run lacks the published codec, statements about it may be tested on the modified one.
    """
    styles = _class_styles(type(codec))
    return next((str(style["based_on"]) for style in styles if "based_on" in style), "")


def registered_name(kind: type) -> str:
    """Return the name under which puckbench registers a class of codecs, or "" if it does not."""
    if not kind.__module__.startswith("puckbench.codecs."):
        return ""
    try:
        return CODECS.name_of(kind)
    except StopIteration:
        return ""


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
    trust([getattr(codec, "training", "")])  # trusted code may name other code
    return adapted(codec)


@cache
def _variant(name: str) -> type[Codec]:
    entry = variants()[name]
    base = codec_class(name, {"class": entry["class"]})
    about = {
        "__module__": base.__module__,
        "__doc__": entry["what"],
        "Options": _with_defaults(base.Options, entry.get("options", {})),
        "rates": _rates(base, entry),
    }
    variant: type[Codec] = type(base.__name__, (base,), about)
    return variant


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
        parameters by name. The first replaces rates for scaled clouds, the second those for clouds
        in metres; lengths among ``rates`` count as ``metric_rates``. Budgets of bits, such as
        ``1.5bpp``, hold for both; a list has either budgets or rates.

    Returns
    -------
    dict
        ``class`` (where it is defined), ``options``, ``rates`` (for scaled clouds) and, if there
        are any, ``metric_rates``; all with defaults filled in.

    Raises
    ------
    InputError
        The codec, an option or a rate is unknown, or the codec has no rates.
    """
    codec, changes = open_codec(name, changes), changes or {}
    place = place_of(name, changes)
    trust([place])  # the place of a class that is already loaded
    options = {**changes.get("options", {}), **codec.options.model_dump()}
    return {"class": place, "options": options, **rate_tables(codec, budgets_of(codec))}


def rate_tables(codec: Codec, budgets: Sequence[str] = ()) -> dict[str, dict[str, Parameters]]:
    """Return the rates of a codec's complete entry: ``rates`` and, if any, ``metric_rates``.

    `budgets` are names of budgets at which the codec shall run. They are added to each table that
    is not empty, and the codec chooses among its other rates.
    """
    found = {name: each.parameters for name in budgets if (each := budget_of(codec, name))}
    scaled, metric = scaled_rates(codec.rates), metric_rates(codec.rates)
    tables = {"rates": {**scaled, **found} if scaled else scaled}
    return {**tables, "metric_rates": {**metric, **found}} if metric else tables


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
        The codec, an option, a rate or an attribute is unknown, or the codec has no rates.
    """
    codec, changes = codec_class(name, changes), changes or {}
    with naming(f"codec {name}"):
        changes, budgets = _without_budgets(codec, changes)
        rates = _rates(codec, changes)
    if not rates:
        raise InputError(f"codec {name}: neither its entry nor its class names rates")
    try:
        opened = codec(name=name, rates=rates, **changes.get("options", {}))
        if budgets:
            set_budgets(opened, budgets)
        _check_attributes(opened)
        return opened
    except KeyError as error:
        raise InputError(f"codec {name}: a rate lacks the parameter {error}") from error
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"codec {name}: {error}") from error


def _check_attributes(codec: Codec) -> None:
    """Raise InputError if a codec names an attribute that does not exist."""
    known = (REFLECTANCE, COLOUR, RETURNS)
    for attribute in codec.attributes:
        if attribute not in known:
            unknown = f"unknown attribute '{attribute}'{among(str(attribute), known)}"
            raise InputError(f"codec {codec.name}: {unknown}")


def _without_budgets(codec: type[Codec], changes: Entry) -> tuple[Entry, tuple[str, ...]]:
    """Return an entry without the budgets among its rates, and their names.

    A list that has budgets has nothing else, and is left out. In a table, as `rate_tables` makes
    it, budgets are those names whose parameter is their amount.
    """
    others, budgets = dict(changes), dict[str, None]()
    for key in ("rates", "metric_rates"):
        requested = changes.get(key) or ()
        if isinstance(requested, Mapping):
            found: Sequence[str] = [
                name
                for name, parameters in requested.items()
                if (each := budget_of(codec, name)) and parameters == each.parameters
            ]
            if found:
                rest = {name: part for name, part in requested.items() if name not in found}
                others[key] = rest or None
        elif found := budgets_among(codec, requested):
            for name in found:
                if name.endswith("mbps"):
                    raise InputError(f"{key}: {name}: megabits per second are for drives")
            others[key] = None
        budgets |= dict.fromkeys(found)
    return others, tuple(budgets)


def _rates(codec: type[Codec], changes: Entry) -> dict[str, Parameters]:
    """Return the parameters of the rates that an entry requests.

    Under "rates" and "metric_rates", an entry has a dict of parameters by rate name, or a list of
    rate names. By default, all rates are returned. Lengths may be under either key.
    """
    tables = {"rates": scaled_rates(codec.rates), "metric_rates": metric_rates(codec.rates)}
    requested = {key: changes[key] for key in tables if changes.get(key) is not None}
    if isinstance(requested.get("metric_rates"), Mapping):
        check_metric(requested["metric_rates"])
    names = requested.get("rates", ())
    is_table = isinstance(names, Mapping)
    found = metric_rates(names) if is_table else [n for n in names if find_rate(codec, n)]
    if lengths := [rate for rate in found if rate not in tables["rates"]]:
        others = [rate for rate in names if rate not in lengths]
        more = requested.get("metric_rates", ())
        if is_table:
            requested["rates"] = {rate: names[rate] for rate in others}
            requested["metric_rates"] = {**dict(more), **{rate: names[rate] for rate in lengths}}
        else:
            requested |= {"rates": others, "metric_rates": [*more, *lengths]}
    parts = (_selected(codec, table, requested.get(key, table)) for key, table in tables.items())
    return {name: parameters for part in parts for name, parameters in part.items()}


def _selected(
    codec: type[Codec], offered: Entry, requested: Entry | Sequence[str]
) -> dict[str, Parameters]:
    if isinstance(requested, Mapping):
        return dict(requested)
    selected = {}
    for rate in requested:
        name, parameters = find_rate(codec, rate) or (rate, None)
        if parameters is None or (name not in offered and name in scaled_rates(codec.rates)):
            raise InputError(f"unknown rate '{rate}'{among(rate, offered)}")
        selected[name] = parameters
    if selected.keys() <= offered.keys():
        return {name: offered[name] for name in offered if name in selected}
    return dict(sorted(selected.items(), key=lambda item: -item[1]["step_m"]))


def codes_surfaces(name: str, changes: Entry | None = None) -> bool:
    """Return whether a codec decodes a mesh with labelled primitives (see `Codec.surfaces`).

    The arguments are those of `entry`.
    """
    defines = codec_class(name, changes).surfaces is not Codec.surfaces
    return bool((changes or {}).get("surfaces", defines))


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
    defined = getattr(codec_class(name, changes), "training", "")
    place = str((changes or {}).get("training", defined))
    if place and not is_place(place):  # in the codec's file
        place = f"{module_of(place_of(name, changes))}:{place}"
        trust([place])
    return place


def codec_of(stream: bytes) -> str:
    """Return the name of the codec that made a stream, found by the stream's first bytes (magic).

    If several codecs match, the one with the lowest rank is returned. Raises InputError if none
    matches.
    """
    stream = unshifted(without_unit(unshifted(stream).stream).stream).stream
    for name, codec in codecs().items():
        if codec.magic and stream.startswith(codec.magic):
            return name
    if stream.startswith(_BARE_GPCC):
        raise InputError("the stream may be a bare one of G-PCC: name the codec (--codec gpcc)")
    raise InputError("no codec recognises the stream: name its codec (--codec)")


def module_of(place: str) -> str:
    """Return the name of the module that defines a codec's class."""
    return place.rpartition(":")[0]

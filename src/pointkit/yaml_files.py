"""Reading of YAML 1.2 (core schema), and writing of YAML that versions 1.1 and 1.2 read alike.

The parser is PyYAML's, but PyYAML follows YAML 1.1: ``03000`` is 1536, ``on`` is true, ``1e3`` is a
text, ``12:30`` is 750, and the last value of a repeated key counts. This module replaces these
rules.

References
----------
YAML Ain't Markup Language, version 1.2, revision 1.2.2, 2021, section 10.3.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import yaml
from yaml.constructor import SafeConstructor
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from yaml.resolver import Resolver

from pointkit.errors import InputError
from pointkit.files import read_bytes

_TAG = "tag:yaml.org,2002:"
_NUMBER = [*"-+.0123456789"]
_CORE_SCHEMA = {
    "null": (r"null|Null|NULL|~|", ["n", "N", "~", ""]),
    "bool": (r"true|True|TRUE|false|False|FALSE", [*"tTfF"]),
    "int": (r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", _NUMBER),
    "float": (
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"
        r"|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        _NUMBER,
    ),
    "merge": (r"<<", ["<"]),  # of YAML 1.1, and read by nearly every program
}
_MOST_LEVELS = 100
_MOST_NODES, _MOST_REPEATS = 100_000, 10
"""Limit of nodes after expanding aliases: `_MOST_NODES`, plus `_MOST_REPEATS` per node in the file.
"""


_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Parser):  # type: ignore[misc]
    yaml_implicit_resolvers: ClassVar[dict[str, Any]] = {}


class _Dumper(yaml.SafeDumper): ...


for _name, (_pattern, _first) in _CORE_SCHEMA.items():
    _whole = re.compile(f"^(?:{_pattern})$")
    _Loader.add_implicit_resolver(_TAG + _name, _whole, _first)
    _Dumper.add_implicit_resolver(_TAG + _name, _whole, _first)


def _integer(loader: _Loader, node: ScalarNode) -> int:
    text = loader.construct_scalar(node)
    return int(text, 0) if text[:2] in ("0o", "0x") else int(text)


def _number(loader: _Loader, node: ScalarNode) -> float:
    text = loader.construct_scalar(node).lower()
    return float(text.replace(".inf", "inf").replace(".nan", "nan"))


def _truth(loader: _Loader, node: ScalarNode) -> bool:
    return bool(["false", "true"].index(loader.construct_scalar(node).lower()))


_Loader.add_constructor(_TAG + "int", _integer)
_Loader.add_constructor(_TAG + "float", _number)
_Loader.add_constructor(_TAG + "bool", _truth)


def read_yaml(path: Path, alike: bool = False) -> Any:
    """Read a YAML file by the rules of YAML 1.2.

    Parameters
    ----------
    path
        The file, which has one document.
    alike
        Whether to refuse values that YAML 1.1 and 1.2 read differently, as needed for files that
        Snakemake (YAML 1.1) also reads.

    Returns
    -------
    object
        Dictionaries, lists, texts, numbers, truth values and None; None for an empty file.

    Raises
    ------
    InputError
        The file is no YAML, repeats a key, is nested more than 100 levels deep, or has aliases
        that expand to too many nodes. The message is one line with the file and the line.
    """
    data = read_bytes(path)
    try:
        _check_levels(data)
        loader = _Loader(data)
        node = loader.get_single_node()
        if node is None:
            return None
        _check(loader, node, alike)
        return loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}: " if mark else ""
        fault = " ".join(str(error.problem or error.context).split())
        raise InputError(f"{path}: {place}not valid YAML ({fault})") from error
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _check_levels(data: bytes) -> None:
    level = 0
    for event in yaml.parse(data, Loader=_Parser):
        level += isinstance(event, yaml.CollectionStartEvent)
        level -= isinstance(event, yaml.CollectionEndEvent)
        if level > _MOST_LEVELS:
            raise InputError(f"{_line(event)}: nested more than {_MOST_LEVELS} levels deep")


def _check(loader: _Loader, root: Node, alike: bool) -> None:
    sizes: dict[int, int] = {}
    for node in _nodes(root, sizes):
        if sizes[id(node)] > _MOST_NODES + _MOST_REPEATS * len(sizes):
            raise InputError(f"{_line(node)}: its aliases expand to too many nodes")
        if isinstance(node, MappingNode):
            _check_keys(loader, node)
        if alike:
            for name, part in _scalars(node):
                _check_alike(loader, name, part)


def _scalars(node: Node) -> Iterator[tuple[str, ScalarNode]]:
    pairs = node.value if isinstance(node, MappingNode) else ()
    items = node.value if isinstance(node, SequenceNode) else ()
    parts = [("", item) for item in items]
    for key, value in pairs:
        parts += [("", key), (f"{key.value}: ", value)]
    yield from ((name, part) for name, part in parts if isinstance(part, ScalarNode))


def _nodes(node: Node, sizes: dict[int, int]) -> Iterator[Node]:
    """Yield the nodes of a tree, each after its descendants.

    `sizes` receives the number of nodes in each node's subtree, with aliases expanded, by
    ``id(node)``.
    """
    if id(node) in sizes:
        if not sizes[id(node)]:
            raise InputError(f"{_line(node)}: an alias refers to a node that contains it")
        return
    sizes[id(node)] = 0
    parts = [] if isinstance(node, ScalarNode) else node.value
    if isinstance(node, MappingNode):
        parts = [part for pair in parts for part in pair]
    for part in parts:
        yield from _nodes(part, sizes)
    sizes[id(node)] = 1 + sum(sizes[id(part)] for part in parts)
    yield node


def _check_keys(loader: _Loader, node: MappingNode) -> None:
    first: dict[Any, Node] = {}
    for key, _ in node.value:
        if not isinstance(key, ScalarNode):
            raise InputError(f"{_line(key)}: a key must be a word or a number")
        is_merge = key.tag == f"{_TAG}merge"
        value = key.value if is_merge else loader.construct_object(key)
        if value in first:
            earlier = _line(first[value])
            raise InputError(f"{_line(key)}: the key {key.value!r} is repeated (see {earlier})")
        first[value] = key


def _check_alike(loader: _Loader, name: str, node: ScalarNode) -> None:
    if node.style or node.tag == f"{_TAG}merge":
        return
    tag = Resolver().resolve(ScalarNode, node.value, (True, False))  # type: ignore[no-untyped-call]
    old = SafeConstructor().construct_object(ScalarNode(tag, node.value))
    new = loader.construct_object(node)
    if (type(old), str(old)) != (type(new), str(new)):
        plain = yaml.safe_dump(new).split()[0]
        number = "" if isinstance(new, str) else f"write {plain}, or "
        advice = f"{number}put it in quotes for a text"
        fault = f"{name}{node.value} is {old!r} in YAML 1.1, which Snakemake reads"
        raise InputError(f"{_line(node)}: {fault}: {advice}")


def _line(part: Node | yaml.Event) -> str:
    return f"line {part.start_mark.line + 1}" if part.start_mark else "a line"


def yaml_text(value: Mapping[str, Any]) -> str:
    """Return a mapping as YAML text with the order of its keys.

    Each list of numbers and texts is on one line.
    """
    return str(
        yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)
    )

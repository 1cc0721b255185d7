"""YAML is read as version 1.2 reads it, and nothing in it replaces anything else."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointkit.errors import InputError
from pointkit.files import read_json
from pointkit.yaml_files import read_yaml, yaml_text

# YAML 1.2.2, section 10.3.2 and example 10.9.
TEXTS = "on off yes No y nULL tRUE nan inf 12:30 1_000 0b11 2020-01-01 1e e3 . = 0o8 0xg 1.2.3 --1"
CORE_SCHEMA: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict(zip(TEXTS.split(), TEXTS.split(), strict=True)),
    "'03'": "03",
    '"1e3"': "1e3",
    "!!str 5": "5",
    "!!float 5": 5.0,
    "0": 0,
    "0o17": 15,
    "0x3A": 58,
    "-19": -19,
    "+12": 12,
    "03000": 3000,
    "08": 8,
    "0.": 0.0,
    "-0.0": -0.0,
    ".5": 0.5,
    "+12e03": 12000.0,
    "-2E+05": -200_000.0,
    "1e3": 1000.0,
    "1.5e-3": 0.0015,
    ".inf": math.inf,
    "-.Inf": -math.inf,
    "+.INF": math.inf,
}


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize("text", CORE_SCHEMA)
def test_values_are_those_of_the_core_schema(tmp_path: Path, text: str) -> None:
    value = read_yaml(written(tmp_path, f"key: {text}\n"))["key"]
    assert (type(value), repr(value)) == (type(CORE_SCHEMA[text]), repr(CORE_SCHEMA[text]))


def test_not_a_number_is_a_number(tmp_path: Path) -> None:
    assert all(map(math.isnan, read_yaml(written(tmp_path, "[.nan, .NaN, .NAN]"))))


def test_keys_are_texts_and_numbers_as_they_are_written(tmp_path: Path) -> None:
    assert read_yaml(written(tmp_path, "on: 1\nyes: 2\n03: 3\n")) == {"on": 1, "yes": 2, 3: 3}


def test_an_empty_file_is_nothing(tmp_path: Path) -> None:
    assert read_yaml(written(tmp_path, "# nothing\n")) is None


def test_anchors_and_merged_mappings(tmp_path: Path) -> None:
    text = "a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\nc: [*a, *a]\nd: {<<: [*a, {z: 4}]}\n"
    assert read_yaml(written(tmp_path, text), alike=True) == {
        "a": {"x": 1, "y": 2},
        "b": {"x": 1, "y": 3},
        "c": [{"x": 1, "y": 2}] * 2,
        "d": {"x": 1, "y": 2, "z": 4},
    }


def bomb(item: str) -> str:
    """Thirty lines of which each stands for nine times the one before it."""
    parts = ["1", *(", ".join([f"*a{number}"] * 9) for number in range(29))]
    return "\n".join(
        f"a{number}: &a{number} {item.format(part)}" for number, part in enumerate(parts)
    )


FAULTS = {
    "twice": ("a: 1\nb: 2\na: 3\n", "line 3: the key 'a' is repeated (see line 1)"),
    "twice_below": ("a:\n  b: 1\n  b: 1\n", "line 3: the key 'b' is repeated (see line 2)"),
    "twice_in_flow": ("[{a: 1, a: 1}]", "line 1: the key 'a' is repeated (see line 1)"),
    "equal_numbers": ("1: a\n0x1: b\n", "line 2: the key '0x1' is repeated (see line 1)"),
    "merged_twice": ("a: &a {}\nb: {<<: *a, <<: *a}", "line 2: the key '<<' is repeated"),
    "list_as_key": ("a: 1\n[1]: 2\n", "line 2: a key must be a word or a number"),
    "unfinished": ("a: 1\nb: [\n", "line 3: not valid YAML ("),
    "tabs": ("a:\n\tb: 1\n", "line 2: not valid YAML ("),
    "two_documents": ("a: 1\n---\nb: 1\n", "line 2: not valid YAML (but found another document)"),
    "python": ("a: !!python/name:os.system\n", "line 1: not valid YAML (could not determine"),
    "no_anchor": ("a: 1\nb: *c\n", "line 2: not valid YAML (found undefined alias"),
    "not_a_truth": ("!!bool maybe", "not valid YAML ("),
    "long_number": ("a: " + "9" * 5000, "not valid YAML ("),
    "not_utf8": (b"a: \xff\xff", "not valid YAML ("),
    "levels_of_lists": ("[" * 200_000, "line 1: nested more than 100 levels deep"),
    "levels_of_lines": (
        "".join(f"{' ' * k}a:\n" for k in range(200)),
        "line 101: nested more than 100",
    ),
    "lists_of_aliases": (bomb("[{}]"), "line 6: its aliases expand to too many nodes"),
    "merged_aliases": (
        bomb("{{<<: [{}]}}").replace("<<: [1]", "x: 1"),
        "line 6: its aliases expand to too many nodes",
    ),
    "endless": ("a: &a\n  b: *a\n", "line 1: an alias refers to a node that contains it"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_one_line_that_names_file_and_line(tmp_path: Path, name: str) -> None:
    text, fault = FAULTS[name]
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(f"{path}: {fault}")
    assert "\n" not in str(caught.value)


def test_a_hundred_levels_are_read(tmp_path: Path) -> None:
    assert read_yaml(written(tmp_path, "[" * 100 + "]" * 100))


def test_aliases_may_stand_for_a_hundred_thousand_nodes_and_ten_for_each(tmp_path: Path) -> None:
    def often(count: int) -> Path:
        return written(tmp_path, f"a: &a []\nb: [{', '.join(['*a'] * count)}]")

    assert read_yaml(often(100_045))  # five nodes, and with the aliases 100,050
    with pytest.raises(InputError, match="line 1: its aliases expand"):
        read_yaml(often(100_046))


def test_a_large_file_may_use_an_alias_often(tmp_path: Path) -> None:
    items = ", ".join(["*a"] * 20_000)
    assert len(read_yaml(written(tmp_path, f"a: &a [1, 2, 3]\nb: [{items}]"))["b"]) == 20_000


AMBIGUOUS = {
    "03000": "03000 is 1536 in YAML 1.1, which Snakemake reads: write 3000, or put it in quotes",
    "on": "on is True in YAML 1.1, which Snakemake reads: put it in quotes for a text",
    "1e-5": "1e-5 is '1e-5' in YAML 1.1, which Snakemake reads: write 1.0e-05, or put it in",
    "12:30": "12:30 is 750 in YAML 1.1",
    "1_000": "1_000 is 1000 in YAML 1.1",
}


@pytest.mark.parametrize("text", AMBIGUOUS)
def test_what_snakemake_reads_as_another_value_is_refused(tmp_path: Path, text: str) -> None:
    for content, key in (
        (f"a: 1\nb: {text}", "b: "),
        (f"a:\n- {text}", ""),
        (f"a: 1\n{text}: 1", ""),
    ):
        path = written(tmp_path, content)
        with pytest.raises(InputError) as caught:
            read_yaml(path, alike=True)
        assert str(caught.value).startswith(f"{path}: line 2: {key}{AMBIGUOUS[text]}")
        assert read_yaml(path)


def test_what_both_versions_read_alike_is_taken(tmp_path: Path) -> None:
    text = (
        "a: [1, 1.5, .inf, .nan, true, ~, on the wall, '03', \"on\", 1.0e-5, -2.5e+3]\nb: |\n  on\n"
    )
    values = read_yaml(written(tmp_path, text), alike=True)
    assert values["a"][7:] == ["03", "on", 1e-5, -2500.0]
    assert values["b"] == "on\n"


PLAIN = st.one_of(
    *(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False)),
    st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp"])),
    st.sampled_from([text for text in CORE_SCHEMA if text and text[0] not in "!'\""]),
)


@given(st.dictionaries(st.sampled_from(["a", "on", "1e3", "03"]), st.lists(PLAIN, max_size=5)))
def test_what_is_written_is_read_alike_by_both_versions(content: dict[str, Any]) -> None:
    import tempfile

    import yaml

    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder), yaml_text(content))
        assert read_yaml(path, alike=True) == content
    assert yaml.safe_load(yaml_text(content)) == content


def test_mappings_are_written_in_their_order_and_lists_on_lines_of_a_hundred() -> None:
    content = {"b": {"z": 1, "y": [1, 2]}, "a": list(range(60))}
    lines = yaml_text(content).splitlines()
    assert lines[:3] == ["b:", "  z: 1", "  y: [1, 2]"]
    assert lines[3].startswith("a: [0, 1, 2, ")
    assert [len(line) for line in lines[3:-1]] == [101, 101]


def test_a_key_that_json_has_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_text('{"a": {"b": 1, "c": 2, "b": 3}}')
    with pytest.raises(InputError, match=r"file\.json: not valid JSON \(the key 'b' is repeated\)"):
        read_json(path)

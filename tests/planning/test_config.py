from pathlib import Path

import pytest

from puckbench.core.errors import InputError
from puckbench.planning.config import checked, read_schema

ROOT = Path(__file__).parents[2]
SCHEMA = read_schema(ROOT / "workflow" / "schemas" / "config.schema.yaml")


def _config() -> dict:
    return {
        "scenes": {"a": {"loader": "embedded_rooms"}},
        "datasets": {"d": {"scenes": "a", "make": "scan"}},
    }


def test_defaults_are_filled_in_at_every_depth() -> None:
    config = checked(_config(), SCHEMA)
    assert config["results"] == "results"
    assert config["codecs"] == {"draco": {}}
    assert config["timing"]["repeats"] == 3
    assert config["figures"]["style"] == {}
    assert config["datasets"]["d"]["neighbours"] == 30
    assert config["datasets"]["d"]["size"] == 1024
    assert config["scenes"]["a"]["options"] == {}


def test_the_users_configuration_is_not_changed() -> None:
    config = _config()
    checked(config, SCHEMA)
    assert config == _config()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("datasetz",), {}, "unknown key 'datasetz' .known: bd_rate, codecs, datasets"),
        (("datasets", "d", "maek"), "scan", r"datasets\.d: unknown key 'maek'"),
        (
            ("datasets", "d", "make"),
            "scna",
            r"datasets\.d\.make: 'scna' is not allowed .allowed: s",
        ),
        (("seed",), "one", "seed: 'one' is not of type 'integer'"),
        (("seed",), -1, "seed: -1 is less than the minimum"),
        (("datasets", "d", "points"), 0, r"datasets\.d\.points: 0 is less"),
        (
            ("datasets", "bad name"),
            {"scenes": "a", "make": "scan"},
            "datasets: 'bad name' does not",
        ),
        (("results",), "my results", "results: 'my results' does not match"),
        (("codecs",), {"x": {"rates": {"r 1": {}}}}, r"codecs\.x\.rates: 'r 1' does not match"),
        (("timing",), {"repeat": 2}, "timing: unknown key 'repeat' .known: exclusive, repeats"),
        (("figures",), {"examples": {"object": "x"}}, r"figures\.examples\.object: 'x' does not"),
    ],
)
def test_a_fault_is_one_line_with_key_value_and_what_is_allowed(
    path: tuple[str, ...], value: object, message: str
) -> None:
    config = _config()
    place = config
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(InputError, match=message) as caught:
        checked(config, SCHEMA)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("missing", ["scenes", "datasets"])
def test_what_is_required_is_named(missing: str) -> None:
    config = _config()
    del config[missing]
    with pytest.raises(InputError, match=f"'{missing}' is a required property"):
        checked(config, SCHEMA)


def test_every_key_is_documented() -> None:
    """config/README.md names every key of the schema."""
    text = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    keys = {
        key
        for part in [SCHEMA, *SCHEMA["$defs"].values(), *SCHEMA["properties"].values()]
        for key in part.get("properties", {})
    }
    assert {key for key in keys if f"`{key}`" not in text} == set()


def _thesis() -> dict:
    return {
        "results": "results/t",
        "stand_in": True,
        "scenes": {
            "a": {
                "loader": "s3dis",
                "options": {"path": "nowhere"},
                "stand_in": {"loader": "embedded_areas", "options": {"rooms": 1}},
            },
            "b": {"loader": "embedded_rooms"},
        },
        "datasets": {
            "d": {"scenes": "a", "make": "cloud", "size": 512, "stand_in": {"make": "sample"}}
        },
        "figures": {
            "examples": {"raw": "d/x"},
            "stand_in": {"examples": {"raw": "d/y"}},
        },
    }


def test_generated_data_stand_in_where_they_are_asked_for() -> None:
    config = checked(_thesis(), SCHEMA)
    assert config["scenes"]["a"] == {"loader": "embedded_areas", "options": {"rooms": 1}}
    assert config["scenes"]["b"]["loader"] == "embedded_rooms"
    assert (config["datasets"]["d"]["make"], config["datasets"]["d"]["size"]) == ("sample", 512)
    assert config["figures"]["examples"] == {"raw": "d/y"}
    assert config["results"] == "results/t_stand_in"


@pytest.mark.parametrize("off", [False, "false"])
def test_without_the_switch_the_data_are_those_on_disk(off: object) -> None:
    config = checked(_thesis() | {"stand_in": off}, SCHEMA)
    assert config["scenes"]["a"]["loader"] == "s3dis"
    assert config["datasets"]["d"]["make"] == "cloud"
    assert config["figures"]["examples"] == {"raw": "d/x"}
    assert config["results"] == "results/t"


def test_the_switch_may_come_as_text_from_snakemakes_command_line() -> None:
    assert checked(_thesis() | {"stand_in": "true"}, SCHEMA)["stand_in"] is True
    with pytest.raises(InputError, match="stand_in: 'yes' is not of type 'boolean'"):
        checked(_thesis() | {"stand_in": "yes"}, SCHEMA)


def test_a_fault_in_a_stand_in_is_named() -> None:
    config = _thesis()
    config["scenes"]["a"]["stand_in"] = {"loadr": "embedded_areas", "loader": "x"}
    with pytest.raises(InputError, match=r"scenes\.a.*loadr"):
        checked(config | {"stand_in": False}, SCHEMA)


def test_exclusive_timing_has_a_short_form() -> None:
    timing = checked(_config() | {"timing": "exclusive"}, SCHEMA)["timing"]
    assert timing == {"exclusive": True, "repeats": 3, "threads": 1}

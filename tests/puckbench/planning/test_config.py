from pathlib import Path

import pytest

from pointkit.errors import InputError
from puckbench.planning.config import checked

ROOT = Path(__file__).parents[3]


def _config() -> dict:
    return {
        "scene_sets": {"a": {"loader": "embedded_rooms"}},
        "datasets": {"d": {"scene_set": "a", "make": "scan"}},
    }


def test_defaults_are_filled_in_at_every_depth() -> None:
    config = checked(_config())
    assert config.results == "results"
    assert list(config.codecs) == ["draco"]
    assert config.codec("draco") == {}
    assert config.as_json()["codecs"] == {"draco": {}}
    assert config.as_json()["datasets"]["d"]["neighbours"] == 30
    assert config.timing.repeats == 3
    assert config.figures.style == {}
    assert config.datasets["d"].neighbours == 30
    assert config.datasets["d"].size == 1024
    assert config.scene_sets["a"].options == {}


def test_the_users_configuration_is_not_changed() -> None:
    config = _config()
    checked(config)
    assert config == _config()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("datasetz",), {}, "the configuration: unknown key 'datasetz' .known: results, seed"),
        (("datasetz",), {}, "did you mean 'datasets'"),
        (("datasets", "d", "maek"), "scan", r"datasets\.d: unknown key 'maek'"),
        (
            ("datasets", "d", "make"),
            "scna",
            r"datasets\.d\.make is 'scna', but must be 'sample', 'scan' or 'cloud'",
        ),
        (("seed",), "one", "seed is 'one', but must be a valid integer"),
        (("seed",), -1, "seed is -1, but must be greater than or equal to 0"),
        (("datasets", "d", "points"), 0, r"datasets\.d\.points is 0, but must be greater"),
        (("datasets", "d", "size"), "x", r"size is 'x', but must be a valid integer or 'grid'"),
        (("datasets", "d", "views"), 3, r"datasets\.d\.views: 3 pixels are too few"),
        (("datasets", "d", "stand_in"), {"maek": 1}, r"datasets\.d\.stand_in: unknown key 'maek'"),
        (
            ("datasets", "bad name"),
            {"scene_set": "a", "make": "scan"},
            "'bad name', but must be a name",
        ),
        (("results",), "my;results", "results is 'my;results', but must be a name that matches"),
        (
            ("codecs",),
            {"x": {"rates": {"r 1": {}}}},
            r"codecs\.x\.rates\.r 1 is 'r 1', but must be",
        ),
        (("codecs",), {"x": {"klass": "a"}}, r"codecs\.x: unknown key 'klass' .known: class"),
        (("codecs",), {}, "codecs is {}, but must have at least 1"),
        (("timing",), {"repeat": 2}, "timing: unknown key 'repeat' .known: repeats, exclusive"),
        (
            ("figures",),
            {"examples": {"object": "x"}},
            r"figures\.examples\.object is 'x', but must",
        ),
        (("sensor_study",), True, "sensor_study is True, but must be"),
        (("scene_sets", "a", "select"), ["x", "x"], r"scene_sets\.a\.select: an entry is repeated"),
        (
            ("scene_sets", "a", "stand_in"),
            {"loader": "x", "stand_in": {"loader": "y"}},
            r"scene_sets\.a\.stand_in: unknown key 'stand_in' .known: loader, options, seed",
        ),
        (("figures",), {"stand_in": {"stile": 1}}, r"figures\.stand_in: unknown key 'stile'"),
        (("bd_rate",), {"metrics": ["a", "a"]}, r"bd_rate\.metrics: an entry is repeated"),
        (
            ("scene_sets", "a", "select"),
            [],
            r"scene_sets\.a\.select is \(\), but must have at least 1",
        ),
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
        checked(config)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("missing", ["scene_sets", "datasets"])
def test_what_is_required_is_named(missing: str) -> None:
    config = _config()
    del config[missing]
    with pytest.raises(InputError, match=f"the configuration: the key '{missing}' is missing"):
        checked(config)


def _thesis() -> dict:
    return {
        "results": "results/t",
        "stand_in": True,
        "scene_sets": {
            "a": {
                "loader": "s3dis",
                "options": {"path": "nowhere"},
                "stand_in": {"loader": "embedded_areas", "options": {"rooms": 1}},
            },
            "b": {"loader": "embedded_rooms"},
        },
        "datasets": {
            "d": {"scene_set": "a", "make": "cloud", "size": 512, "stand_in": {"make": "sample"}}
        },
        "figures": {
            "examples": {"raw": "d/x"},
            "stand_in": {"examples": {"raw": "d/y"}},
        },
    }


def test_generated_data_stand_in_where_they_are_asked_for() -> None:
    config = checked(_thesis())
    assert (config.scene_sets["a"].loader, config.scene_sets["a"].options) == (
        "embedded_areas",
        {"rooms": 1},
    )
    assert config.scene_sets["b"].loader == "embedded_rooms"
    assert (config.datasets["d"].make, config.datasets["d"].size) == ("sample", 512)
    assert config.figures.examples.clouds_by_kind() == {"raw": "d/y"}
    assert config.results == "results/t_stand_in"


@pytest.mark.parametrize("off", [False, "false"])
def test_without_the_switch_the_data_are_those_on_disk(off: object) -> None:
    config = checked(_thesis() | {"stand_in": off})
    assert config.scene_sets["a"].loader == "s3dis"
    assert config.datasets["d"].make == "cloud"
    assert config.figures.examples.clouds_by_kind() == {"raw": "d/x"}
    assert config.results == "results/t"


def test_the_switch_may_come_as_text_from_snakemakes_command_line() -> None:
    assert checked(_thesis() | {"stand_in": "true"}).stand_in is True
    with pytest.raises(InputError, match="stand_in is 'yes', but must be a valid boolean"):
        checked(_thesis() | {"stand_in": "yes"})


def test_a_fault_in_a_stand_in_is_named() -> None:
    config = _thesis()
    config["scene_sets"]["a"]["stand_in"] = {"loadr": "embedded_areas", "loader": "x"}
    with pytest.raises(InputError, match=r"scene_sets\.a.*loadr"):
        checked(config | {"stand_in": False})


def test_exclusive_timing_has_a_short_form() -> None:
    timing = checked(_config() | {"timing": "exclusive"}).timing
    expected = {"exclusive": True, "repeats": 3, "threads": 1, "timeout_s": None}
    assert timing.model_dump() == expected

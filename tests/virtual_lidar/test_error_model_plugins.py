"""Error models from outside of the tree: a user's file, another package, and their faults."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from pointkit.errors import InputError
from pointkit.registry import Registry, trust
from virtual_lidar import error_model_names, open_error_model
from virtual_lidar.errors import error_model_style
from virtual_lidar.errors.model import ErrorModel

SOURCE = '''"""A sensor that reads too far."""

from pydantic import PositiveFloat

from virtual_lidar.errors import ErrorModel


class TooFar(ErrorModel):
    """Every range is a share too long."""

    title, colour = "Too far", "#123456"

    share: PositiveFloat = 0.01

    def perturb_ranges(self, hits, sensor, draws):
        """True distance, lengthened."""
        return hits.distance * (1 + self.share)
'''


@pytest.fixture
def place(tmp_path: Path) -> str:
    (tmp_path / "far.py").write_text(SOURCE)
    trust([named := f"{tmp_path / 'far.py'}:TooFar"])
    return named


def test_another_packages_model_has_a_name(
    tmp_path: Path, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = [EntryPoint("too_far", "far:TooFar", "puckbench.error_models")]
    result = {"puckbench.error_models": points}
    monkeypatch.setattr("pointkit.registry.entry_points", lambda group: result.get(group, []))
    monkeypatch.syspath_prepend(str(tmp_path))
    models: Registry[type[ErrorModel]] = Registry("error model", "errors")
    monkeypatch.setattr("virtual_lidar.errors.ERROR_MODELS", models)
    assert "too_far" in error_model_names()
    assert open_error_model("too_far").described() == {"model": "TooFar", "share": 0.01}
    sys.modules.pop("far", None)


@pytest.mark.parametrize(
    ("name", "options", "fault"),
    [
        ("{place}", {"share": -1}, "TooFar: share is -1, but must be greater than 0"),
        ("{place}", {"part": 1}, "unknown option 'part' (known: share)"),
        ("{place}Missing", {}, "cannot load"),
        ("nowhere.py:Model", {}, "cannot load 'nowhere.py:Model'"),
        ("pathlib:Path", {}, "not a class of virtual_lidar.errors.ErrorModel"),
        ("vlp17", {}, "did you mean 'vlp16'?"),
    ],
)
def test_faults_of_a_users_model_are_one_line(
    place: str, name: str, options: dict[str, object], fault: str
) -> None:
    trust([name.format(place=place)])
    with pytest.raises(InputError) as caught:
        open_error_model(name.format(place=place), options)
    assert fault in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", error_model_names())
def test_every_model_has_a_title_and_a_colour(name: str) -> None:
    style = error_model_style(name)
    assert style.title
    assert style.colour.startswith("#")
    alike = [item for item in error_model_names() if error_model_style(item).colour == style.colour]
    assert alike == [name]

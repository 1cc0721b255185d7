"""What is generated from the models of the configuration is up to date."""

from pathlib import Path

import pytest
from pydantic import BaseModel

from puckbench.planning import config
from puckbench.planning.config_reference import documented, key_table, schema, with_tables

ROOT = Path(__file__).parents[3]
AGAIN = "run python -m puckbench.planning.config_reference"


def test_the_schema_for_editors_is_that_of_the_models() -> None:
    file = ROOT / "workflow" / "schemas" / "config.schema.json"
    assert file.read_text(encoding="utf-8") == schema(), AGAIN


def test_the_tables_of_keys_are_those_of_the_models() -> None:
    text = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    assert with_tables(text) == text, AGAIN


def test_every_key_of_the_configuration_has_its_table() -> None:
    models = {
        name
        for name, result in vars(config).items()
        if isinstance(result, type) and issubclass(result, BaseModel) and name.endswith("Config")
    }
    text = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    assert documented(text) == models


@pytest.mark.parametrize(
    ("model", "row"),
    [
        (config.SceneSetConfig, "| `loader` | required | Name of a loader"),
        (config.DataSetConfig, "| `points` | `500000` | Number of sampled points"),
        (config.CodecConfig, "| `class` |  | Name of the codec of which"),
        (config.StudyConfig, "| `models` | `none, hdl64e, vlp16, vlp16_divergence, vlp16_inciden"),
        (config.RateDeltaConfig, '| `metrics` | `["d1_psnr", "d2_psnr"]` | Columns'),
    ],
)
def test_a_row_has_the_key_its_default_and_its_meaning(model: type[BaseModel], row: str) -> None:
    assert row in key_table(model)

"""Generate the schema and the tables of keys from the models of the configuration.

    python -m puckbench.planning.config_reference

writes `workflow/schemas/config.schema.json` and the tables of `config/README.md`, between lines
``<!-- keys: ModelName -->`` and ``<!-- end of keys -->``.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from puckbench.planning import config

_TABLE = re.compile(r"(<!-- keys: (\w+) -->\n).*?(<!-- end of keys -->)", re.DOTALL)


def schema() -> str:
    """Return the JSON schema of the configuration, as the text of its file."""
    content = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **config.Config.model_json_schema(by_alias=True),
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def key_table(model: type[BaseModel]) -> str:
    """Return a Markdown table of the keys of a model, with their defaults and meanings."""
    rows = [
        f"| `{field.alias or name}` | {_default(field)} | {field.description} |"
        for name, field in model.model_fields.items()
    ]
    return "\n".join(["| key | default | meaning |", "|---|---|---|", *rows]) + "\n"


def with_tables(text: str) -> str:
    """Return a Markdown text in which the tables of keys are replaced by current ones."""

    def table(match: re.Match[str]) -> str:
        return f"{match[1]}{key_table(getattr(config, match[2]))}{match[3]}"

    return _TABLE.sub(table, text)


def documented(text: str) -> set[str]:
    """Return the names of the models whose keys a Markdown text lists."""
    return {match[2] for match in _TABLE.finditer(text)}


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return ""
    if isinstance(value, BaseModel):
        return "see below"
    if isinstance(value, dict) and any(isinstance(item, BaseModel) for item in value.values()):
        return f"`{', '.join(value)}`"
    return f"`{_yaml(value)}`"


def _yaml(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def main(root: Path) -> None:
    """Write the schema and the tables of keys to the files of the repository in folder `root`."""
    readme = root / "config" / "README.md"
    readme.write_text(with_tables(readme.read_text(encoding="utf-8")), encoding="utf-8")
    file = root / "workflow" / "schemas" / "config.schema.json"
    file.write_text(schema(), encoding="utf-8")


if __name__ == "__main__":
    main(Path())

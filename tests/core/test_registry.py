"""Plug-ins of a user's own file beside ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from puckbench.core.errors import InputError
from puckbench.core.registry import Registry


def test_an_added_plugin_is_listed_and_found_by_its_name(tmp_path: Path) -> None:
    registry: Registry[int] = Registry("number")
    (tmp_path / "numbers.py").write_text("seven = 7\n")
    place = f"{tmp_path / 'numbers.py'}:seven"
    registry.add(place)
    registry.add(place)
    assert registry.names() == ["seven"]
    assert registry.get("seven") == 7
    assert registry.place_of("seven") == place
    assert registry.module_of("seven") == str(tmp_path / "numbers.py")
    with pytest.raises(InputError, match=r"other.py:seven: that name is taken"):
        registry.add("other.py:seven")
    with pytest.raises(InputError, match=r"must be module:Name or file.py:Name"):
        registry.add("seven")

"""Errors of users' code are told with their line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import error_text


def test_the_line_is_of_the_users_code_also_where_a_package_raised() -> None:
    with pytest.raises(ValueError, match="cannot reshape") as raised:
        np.reshape(np.zeros(3), (2, 2))
    assert f"({Path(__file__).name}:" in error_text(raised.value)

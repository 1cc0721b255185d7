"""Folders in which the workflow runs: a fresh one, and one where everything has been made."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.bench import Bench


@pytest.fixture(scope="session", autouse=True)
def _one_server(job_server: None) -> None:
    """Let all runs share a server."""


@pytest.fixture
def fresh(tmp_path: Path) -> Bench:
    """A folder where nothing has been made."""
    return Bench(tmp_path)


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A folder where everything has been made; tests leave it so."""
    bench = Bench(tmp_path_factory.mktemp("bench"))
    bench.made()
    return bench

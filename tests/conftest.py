"""Fixtures that tests of several modules ask for by name, and the profile of property tests."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from pointkit.compiling import NOTICE

# No test depends on time: the first example compiles, and machines are busy.
settings.register_profile("any machine", deadline=None, suppress_health_check=list(HealthCheck))
settings.load_profile("any machine")

NOTICE.is_printed = True  # tests compare what else stands on standard error


@pytest.fixture(scope="module", autouse=True)
def no_old_objects_in_collections() -> None:
    """Exclude the objects of earlier modules from garbage collection, which every timing calls."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def one_thread() -> Iterator[None]:
    """PyTorch with one thread: layers as small as the tests' are slower with more."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def job_server() -> None:
    """Start a server that forks the jobs of all runs, each of which would import for seconds."""
    # Here, since tests of other packages run without puckbench.
    from puckbench.steps.fork_server import LEARNED, MODULES, start_fork_server

    source = Path(__file__).parents[1] / "src"
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("PYTHONPATH", str(source))  # as runs set it for jobs
        start_fork_server(1, (*MODULES, *LEARNED))

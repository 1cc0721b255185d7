import numpy as np
import pytest

from pointkit.measurement import measured
from puckbench.codecs.base import Cost


def test_time_is_the_median_of_the_repetitions(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 10.0, 210.0, 300.0, 320.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    result = measured(lambda: None, repeats=3)
    assert (result.least_s, result.seconds, result.most_s) == (1.0, 20.0, 200.0)


def test_peak_memory_is_that_of_the_call_alone() -> None:
    ballast = np.ones(40 * 2**17)  # 40 MiB, there before the call
    result = measured(lambda: np.ones(100 * 2**17).sum())
    assert 95 <= result.peak_mib <= 110
    assert ballast.size


def test_memory_freed_before_the_call_does_not_hide_what_it_needs() -> None:
    np.ones(2**21)  # freed: from now on the allocator keeps chunks of 512 KiB on its heap
    chunks = [np.ones(2**16) for _ in range(400)]
    last = chunks[-1]  # holds the heap's end, so that the 200 MiB below stay resident
    del chunks
    result = measured(lambda: np.ones(100 * 2**17).sum())
    assert 95 <= result.peak_mib <= 110
    assert last.size


def test_the_result_comes_back() -> None:
    assert measured(lambda: "x").result == "x"


def test_the_cost_of_another_process_counts_in_place_of_ours() -> None:
    costs = iter([Cost(5.0, 10.0), Cost(1.0, 30.0), Cost(2.0, 20.0)])
    result = measured(lambda: "x", repeats=3, whole=lambda _: next(costs))
    assert (result.seconds, result.peak_mib) == (2.0, 30.0)


def test_the_spread_is_that_of_the_repetitions() -> None:
    costs = iter([Cost(5.0, 10.0), Cost(1.0, 30.0), Cost(2.0, 20.0)])
    result = measured(lambda: "x", repeats=3, whole=lambda _: next(costs))
    assert result.costs("encode") == {
        "encode_s": 2.0,
        "encode_s_min": 1.0,
        "encode_s_max": 5.0,
        "encode_peak_mib": 30.0,
    }

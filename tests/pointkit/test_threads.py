"""Work shared by threads."""

import threading

import pytest

from pointkit.threads import few_at_once, in_threads


def test_results_keep_their_order_and_threads_run_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    meeting = threading.Barrier(2, timeout=600)

    def work(item: int) -> int:
        meeting.wait()  # one thread alone would not get past this, and fail in the end
        return item * item

    assert in_threads(work, range(6)) == [0, 1, 4, 9, 16, 25]


def test_one_thread_is_the_callers_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert in_threads(lambda _: threading.get_ident(), range(3)) == [threading.get_ident()] * 3


@pytest.mark.parametrize(("threads", "computed"), [("1", 3), ("2", 4)])
def test_few_at_once_computes_hardly_more_than_it_is_asked_for(
    threads: str, computed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    begun: list[int] = []

    def work(item: int) -> int:
        begun.append(item)
        return item * item

    results = few_at_once(work, range(7))
    assert [next(results) for _ in range(3)] == [0, 1, 4]
    assert sorted(begun) == list(range(computed))
    assert list(results) == [9, 16, 25, 36]


def test_calls_within_a_thread_use_no_further_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")

    def own_and_inner(_: int) -> set[int]:
        return {threading.get_ident(), *in_threads(lambda _: threading.get_ident(), range(3))}

    assert [len(threads) for threads in in_threads(own_and_inner, range(2))] == [1, 1]

"""Cached properties do not wait for each other."""

from __future__ import annotations

from threading import Barrier, Thread

from graspcast.io.cached import cached_property


class Slow:
    computed = 0

    def __init__(self, barrier: Barrier):
        self.barrier = barrier

    @cached_property
    def value(self) -> object:
        """Something new each time."""
        self.computed += 1
        self.barrier.wait(5)
        return object()


def test_two_instances_are_computed_at_once_and_each_value_once() -> None:
    barrier = Barrier(2)
    both = [Slow(barrier), Slow(barrier)]
    threads = [Thread(target=lambda each=each: each.value) for each in both]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [each.computed for each in both] == [1, 1]
    assert both[0].value is both[0].value is not both[1].value
    assert isinstance(Slow.value, cached_property)
    assert Slow.value.__doc__ == "Something new each time."


def test_two_threads_get_the_same_value() -> None:
    one, found = Slow(Barrier(2)), []
    threads = [Thread(target=lambda: found.append(one.value)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found[0] is found[1]


def test_a_thread_that_comes_late_keeps_the_first_value() -> None:
    one = Slow(Barrier(1))
    first = one.value
    # Two threads may both have found nothing there.
    assert Slow.value.__get__(one) is first
    assert one.computed == 1

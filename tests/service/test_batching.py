from __future__ import annotations

import asyncio
import threading
from collections.abc import Sequence
from typing import Any

import pytest

from graspcast.service.batching import Batcher
from graspcast.service.replies import RefusedError


def run(batcher: Batcher, *jobs: tuple[str, Any]) -> list[Any]:
    async def ask() -> list[Any]:
        return await asyncio.gather(*(batcher.do(*job) for job in jobs), return_exceptions=True)

    batcher.start()
    try:
        return asyncio.run(ask())
    finally:
        batcher.close()


def test_what_waits_is_done_together_and_goes_to_who_asked() -> None:
    batches: list[list[int]] = []

    def double(items: Sequence[int]) -> list[int]:
        batches.append(list(items))
        return [2 * item for item in items]

    hold = threading.Event()
    batcher = Batcher({"double": double, "wait": lambda x: [hold.wait(9)]}, batch=4)

    async def ask() -> list[int]:
        first = asyncio.create_task(batcher.do("wait", 0))
        await asyncio.sleep(0.05)
        rest = [asyncio.create_task(batcher.do("double", i)) for i in range(6)]
        await asyncio.sleep(0.05)
        hold.set()
        await first
        return list(await asyncio.gather(*rest))

    batcher.start()
    assert asyncio.run(ask()) == [0, 2, 4, 6, 8, 10]
    batcher.close()
    assert batches == [[0, 1, 2, 3], [4, 5]]


def test_an_item_that_fails_fails_alone(caplog: pytest.LogCaptureFixture) -> None:
    def inverse(items: Sequence[int]) -> list[float]:
        return [1 / item for item in items]

    found = run(Batcher({"inverse": inverse}), ("inverse", 2), ("inverse", 0), ("inverse", 4))
    assert found[0] == 0.5
    assert isinstance(found[1], ZeroDivisionError)
    assert found[2] == 0.25


def test_a_result_that_is_an_exception_is_raised() -> None:
    found = run(
        Batcher({"refuse": lambda items: [RefusedError(404, "no") for _ in items]}), ("refuse", 1)
    )
    assert found[0].status == 404


def test_more_than_may_wait_is_refused() -> None:
    hold = threading.Event()

    def wait(items: Sequence[Any]) -> Sequence[Any]:
        hold.wait(9)
        return items

    batcher = Batcher({"wait": wait}, batch=1, waiting=2)

    async def ask() -> RefusedError:
        first = asyncio.create_task(batcher.do("wait", 0))
        await asyncio.sleep(0.05)
        others = [asyncio.create_task(batcher.do("wait", i)) for i in (1, 2)]
        await asyncio.sleep(0.05)
        assert batcher.waiting == 2
        with pytest.raises(RefusedError) as caught:
            await batcher.do("wait", 3)
        hold.set()
        assert await asyncio.gather(first, *others) == [0, 1, 2]
        return caught.value

    batcher.start()
    refusal = asyncio.run(ask())
    batcher.close()
    assert refusal.status == 503
    assert dict(refusal.headers)["Retry-After"]


def test_closing_finishes_what_waits_and_takes_no_more() -> None:
    hold = threading.Event()

    def wait(items: Sequence[Any]) -> Sequence[Any]:
        hold.wait(9)
        return items

    batcher = Batcher({"wait": wait}, batch=1)

    async def ask() -> list[Any]:
        tasks = [asyncio.create_task(batcher.do("wait", i)) for i in range(5)]
        await asyncio.sleep(0.05)
        closing = asyncio.create_task(asyncio.to_thread(batcher.close))
        await asyncio.sleep(0.05)
        with pytest.raises(RefusedError, match="stopping"):
            await batcher.do("wait", 9)
        hold.set()
        await closing
        return await asyncio.gather(*tasks)

    batcher.start()
    assert asyncio.run(ask()) == [0, 1, 2, 3, 4]


def test_it_is_ready_when_prepared_and_what_came_before_is_done_then() -> None:
    hold = threading.Event()
    batcher = Batcher({"same": lambda items: items}, prepare=lambda: hold.wait(9) and None)

    async def ask() -> int:
        task = asyncio.create_task(batcher.do("same", 7))
        await asyncio.sleep(0.05)
        assert not batcher.ready
        hold.set()
        found = await task
        assert batcher.ready
        return int(found)

    batcher.start()
    assert asyncio.run(ask()) == 7
    batcher.close()


def test_several_threads_work_side_by_side() -> None:
    barrier = threading.Barrier(2, timeout=9)

    def meet(items: Sequence[Any]) -> Sequence[Any]:
        barrier.wait()
        return items

    batcher = Batcher({"meet": meet}, batch=1, threads=2)
    assert run(batcher, ("meet", 1), ("meet", 2)) == [1, 2]


def test_a_preparation_that_fails_is_logged_and_work_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def prepare() -> None:
        raise RuntimeError("no compiler")

    batcher = Batcher({"same": lambda items: items}, prepare=prepare)
    assert not batcher.ready
    assert run(batcher, ("same", 1)) == [1]
    assert "the preparation failed; the first verdicts take longer" in caplog.text
    assert batcher.close() is None, "once more changes nothing"


def test_work_of_an_unknown_kind_is_refused() -> None:
    (error,) = run(Batcher({"same": lambda items: items}), ("other", 1))
    assert isinstance(error, ValueError) and "no kind of work is called 'other'" in str(error)
    never = Batcher({"same": lambda items: items})
    never.close()  # before it was started


def test_who_no_longer_waits_gets_nothing_and_the_others_their_answers(
    caplog: pytest.LogCaptureFixture,
) -> None:
    hold = threading.Event()
    batcher = Batcher({"wait": lambda items: [hold.wait(9) for _ in items]}, batch=4)
    batcher.start()

    async def one_leaves() -> Any:
        first = asyncio.create_task(batcher.do("wait", 0))
        await asyncio.sleep(0.05)
        leaves, stays = (asyncio.create_task(batcher.do("wait", i)) for i in (1, 2))
        await asyncio.sleep(0.05)
        leaves.cancel()
        hold.set()
        return await first, await stays

    async def all_leave() -> None:
        task = asyncio.create_task(batcher.do("wait", 0))
        await asyncio.sleep(0.05)
        task.cancel()

    assert asyncio.run(one_leaves()) == (True, True)
    hold.clear()
    asyncio.run(all_leave())  # the loop has ended when the answer comes
    hold.set()
    batcher.close()
    assert "1 answers were ready after the service had stopped" in caplog.text

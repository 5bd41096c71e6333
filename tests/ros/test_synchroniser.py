import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graspcast.errors import InputError, UnknownNameError
from graspcast.ros.synchroniser import Synchroniser

MS = 1_000_000
START = 1_000_000 * MS


def synchroniser(*, tolerance_ms=10, timeout_ms=100, streams=("a", "b")):
    return Synchroniser(streams, tolerance_s=tolerance_ms / 1e3, timeout_s=timeout_ms / 1e3)


def put(sync, stream, at_ms, now_ms=None):
    now = at_ms if now_ms is None else now_ms
    sync.add(stream, START + round(at_ms * MS), f"{stream}{at_ms}", START + round(now * MS))


def due(sync, now_ms):
    return [sorted(s.messages.values()) for s in sync.due(START + round(now_ms * MS))]


def test_messages_within_the_tolerance_come_together_once():
    sync = synchroniser()
    put(sync, "a", 0)
    assert due(sync, 0) == []
    put(sync, "b", 8)
    assert due(sync, 8) == [["a0", "b8"]]
    assert due(sync, 500) == []


def test_stamps_farther_apart_are_two_images_each_with_one_missing():
    sync = synchroniser()
    put(sync, "a", 0)
    put(sync, "b", 11)
    assert due(sync, 50) == []
    (first, second) = sync.due(START + 200 * MS)
    assert sync.missing(first) == ["b"] and sync.missing(second) == ["a"]


def test_the_tolerance_is_between_all_streams_not_from_one_to_the_next():
    sync = synchroniser(streams=("a", "b", "c"))
    for stream, at_ms in (("a", 0), ("b", 8), ("c", 16)):
        put(sync, stream, at_ms)
    assert due(sync, 300) == [["a0", "b8"], ["c16"]]


def test_one_that_is_missing_is_waited_for_until_the_timeout():
    sync = synchroniser()
    put(sync, "a", 0)
    assert due(sync, 99) == []
    assert due(sync, 100) == [["a0"]]


def test_sets_come_out_by_stamp_and_a_complete_one_waits_for_an_earlier_one():
    sync = synchroniser()
    put(sync, "a", 0)
    put(sync, "a", 33)
    put(sync, "b", 33)
    assert due(sync, 40) == []
    put(sync, "b", 0, now_ms=60)
    assert due(sync, 60) == [["a0", "b0"], ["a33", "b33"]]


def test_messages_out_of_order_find_their_image():
    sync = synchroniser()
    for stream, at_ms in (("a", 66), ("b", 33), ("a", 33), ("b", 66)):
        put(sync, stream, at_ms)
    assert due(sync, 67) == [["a33", "b33"], ["a66", "b66"]]


def test_the_nearest_image_is_taken_and_a_tolerance_that_fits_two_is_counted():
    sync = synchroniser(tolerance_ms=20)
    put(sync, "a", 0)
    put(sync, "a", 15.0)  # the first is taken already: the same stream twice within the tolerance
    assert sync.problems.counts() == {"message that repeats a stamp within the tolerance": 1}
    sync = synchroniser(tolerance_ms=20)
    put(sync, "a", 0)
    put(sync, "a", 30)
    put(sync, "b", 17)
    assert "message that fits two images: the tolerance is too large" in sync.problems.counts()
    assert due(sync, 200) == [["a0"], ["a30", "b17"]]


def test_late_repeated_and_unstamped_messages_are_counted_and_not_used():
    sync = synchroniser()
    put(sync, "a", 0)
    put(sync, "a", 0)
    assert due(sync, 150) == [["a0"]]
    put(sync, "b", 0, now_ms=160)
    sync.add("a", 0, "unstamped", START)
    assert sync.problems.counts() == {
        "message that repeats a stamp within the tolerance": 1,
        "message that came too late": 1,
        "message without a stamp": 1,
    }
    assert len(sync) == 0 and due(sync, 1000) == []


def test_the_rest_comes_out_at_the_end():
    sync = synchroniser()
    put(sync, "a", 33)
    put(sync, "b", 0)
    assert [s.stamp for s in sync.rest()] == [START, START + 33 * MS]
    assert sync.rest() == []


def test_after_clearing_nothing_waits_and_nothing_is_late():
    sync = synchroniser()
    put(sync, "a", 0)
    sync.due(START + 500 * MS)
    put(sync, "a", 33)
    sync.clear()
    put(sync, "b", 0)
    assert len(sync) == 1 and not sync.problems


def test_unknown_streams_and_senseless_times_are_refused():
    with pytest.raises(UnknownNameError, match="known: a, b"):
        put(synchroniser(), "c", 0)
    with pytest.raises(InputError, match="tolerance_s should be"):
        Synchroniser(["a"], tolerance_s=float("nan"))
    with pytest.raises(InputError, match="timeout_s should be"):
        Synchroniser(["a"], timeout_s=-1.0)
    with pytest.raises(InputError, match="at least one stream"):
        Synchroniser([])


@settings(max_examples=50)
@given(st.permutations([(s, k) for s in "abc" for k in range(5)]), st.data())
def test_whatever_the_order_each_image_comes_out_whole_and_once(order, data):
    sync = synchroniser(streams=("a", "b", "c"), timeout_ms=3_000_000)
    found = []
    asked_early = data.draw(st.booleans())
    for stream, k in order:
        put(sync, stream, 33 * k + data.draw(st.floats(0, 9)), now_ms=0)
        found += sync.due(START) if asked_early else []
    found += sync.due(START)
    stamps = [s.stamp for s in found]
    assert [len(s.messages) for s in found] == [3] * 5
    assert asked_early or stamps == sorted(stamps)
    assert not sync.problems

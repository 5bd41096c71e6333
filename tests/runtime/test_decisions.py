"""Decisions are identified."""

from __future__ import annotations

from graspcast.runtime.decisions import new_id, without_pose


def test_ids_are_unique_and_in_the_order_of_time() -> None:
    ids = [new_id() for _ in range(10_000)]
    assert len(set(ids)) == len(ids)
    assert all(len(each) == 32 and int(each, 16) > 0 for each in ids)
    times = [each[:12] for each in ids]
    assert times == sorted(times)


def test_an_object_without_a_pose_is_abstained_from() -> None:
    decision = without_pose("d-1", "no estimate by a", gripper="parallel", looks=2)
    assert decision.action == "abstain" and decision.cam_T_obj is None and decision.looks == 2

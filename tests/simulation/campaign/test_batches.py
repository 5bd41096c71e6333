from __future__ import annotations

import numpy as np
import pytest

from campaign_script import make_requests
from graspcast.simulation.campaign.batches import Batches, batch_size


def test_each_trial_is_in_one_batch_and_batches_of_a_setup_follow_each_other() -> None:
    requests = make_requests(50, ("parallel", "three-finger"))
    left = np.arange(7, 100)
    batches = Batches(requests, left)
    assert np.array_equal(np.sort(np.concatenate([b.rows for b in batches])), left)
    setups = [batch.setup for batch in batches]
    assert sorted(setups) == setups or sorted(setups, reverse=True) == setups
    assert len(set(setups)) == 2
    for batch in batches:
        keys = requests.keys[batch.rows]
        assert set(keys.select("object", "gripper", "grasp").iter_rows()) == {batch.setup}
        assert np.array_equal(batch.obj_T_est, requests.obj_T_est[batch.rows])
        assert 1 <= len(batch.rows) <= 16


def test_batches_are_a_sequence_and_none_are_left_of_nothing() -> None:
    requests = make_requests(40)
    batches = Batches(requests, np.arange(40))
    assert len(batches) == 3
    assert [len(batch.rows) for batch in batches[1:]] == [16, 8]
    assert np.array_equal(batches[-1].rows, np.arange(32, 40))
    with pytest.raises(IndexError, match="there are 3 batches"):
        batches[3]
    assert not Batches(requests, np.arange(0))


@pytest.mark.parametrize(
    ("trials", "size"),
    [(1, 16), (100_000, 16), (1_000_000, 100), (10_000_000, 256), (10**9, 256)],
)
def test_large_campaigns_have_larger_batches(trials: int, size: int) -> None:
    assert batch_size(trials) == size

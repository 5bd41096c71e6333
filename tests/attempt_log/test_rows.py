from datetime import UTC, datetime

import numpy as np

from attempt_records import decision, frame, pose
from graspcast.attempt_log.rows import digest_of, matrix, rows_of, utc_text


def test_a_matrix_comes_back_to_the_bit():
    values = np.random.default_rng(0).normal(size=(4, 4))
    stored = rows_of(frame(0, world_T_cam=values)).frame[3]
    np.testing.assert_array_equal(matrix(stored), values)
    assert matrix(None) is None


def test_the_digest_is_of_all_that_a_frame_holds():
    same = rows_of(frame(0)).digest
    assert rows_of(frame(0)).digest == same
    changes = (
        {"look": 2},
        {"world_T_cam": pose()},
        {"estimates": {"epos": []}},
        {"decisions": [decision(0, reason="other")]},
    )
    for changed in changes:
        assert rows_of(frame(0, **changed)).digest != same


def test_a_decision_has_its_own_model_or_the_frames():
    rows = rows_of(frame(0, decision(0), decision(1, model="other"), model="mine")).decisions
    assert [row[-2] for row in rows] == ["mine", "other"]


def test_values_do_not_run_into_each_other():
    assert digest_of(("ab", "c")) != digest_of(("a", "bc")) != digest_of(("a",), ("bc",))


def test_times_have_microseconds_and_order_as_text():
    assert utc_text(datetime(2026, 1, 2, tzinfo=UTC)) == "2026-01-02T00:00:00.000000Z"
    assert utc_text(datetime(9, 1, 1, tzinfo=UTC)) < utc_text(datetime(2026, 1, 1, tzinfo=UTC))

import numpy as np
import pytest

from attempt_records import decision, frame, pose
from graspcast.attempt_log import AttemptLog, OutcomeRecord
from graspcast.attempt_log.episodes import scene_of
from graspcast.attempt_log.recorded import recorded
from graspcast.errors import MismatchError


@pytest.fixture
def log(tmp_path):
    with AttemptLog.open(tmp_path / "log.db") as log:
        yield log


def attempt(log, *frames, failed=()):
    log.add(frames)
    for made in frames:
        for each in made.decisions:
            log.add_outcome(OutcomeRecord(each.id, each.id not in failed))


def test_an_outcome_is_of_the_estimate_that_guided_it_by_rank(log):
    found = {"epos": [("ycbv-5", pose(0.2), 0.3), ("ycbv-5", pose(0.1), 0.9)]}
    made = decision(0, cam_T_obj=pose(0.2)), decision(1, cam_T_obj=pose(0.1), instance=1)
    attempt(log, frame(0, *made, estimates=found), failed=("d0",))
    out = recorded([log])
    rows = out.outcomes.sort("est_id")
    assert rows["estimator"].to_list() == ["epos", "epos"]
    assert rows["est_id"].to_list() == [0, 1]
    assert rows["success"].to_list() == [1, 0]
    assert set(rows["scene_id"]) == {scene_of("e0")}
    table = out.inputs.results["ycbv"]["epos"]
    assert table.score.tolist() == [0.3, 0.9]
    np.testing.assert_array_equal(table.cam_T_obj[0], pose(0.2))


def test_looks_of_an_episode_are_images_of_a_scene_with_camera_poses(log):
    looks = [frame(0, decision(i), look=i + 1, world_T_cam=pose(float(i))) for i in range(2)]
    attempt(log, *looks)
    out = recorded([log])
    scene = scene_of("e0")
    assert sorted(out.motions["ycbv"].world_T_cam) == [(scene, 1), (scene, 2)]
    assert out.outcomes.sort("im_id")["im_id"].to_list() == [1, 2]


def test_without_camera_poses_there_is_no_motion(log):
    attempt(log, frame(0))
    assert recorded([log]).motions == {}


def test_what_is_of_no_estimate_is_left_out_and_counted(log):
    fused = decision(1, guide="fused")
    elsewhere = decision(2, cam_T_obj=pose(0.5), instance=2)
    again = decision(3, instance=3)
    attempt(log, frame(0, decision(0), fused, elsewhere, again))
    out = recorded([log])
    assert len(out.outcomes) == 1
    assert sorted(out.inputs.notes) == [
        "left out 1 outcome of the log: a further grasp by the same estimate",
        "left out 1 outcome of the log: a fused pose guided the grasp",
        "left out 1 outcome of the log: the guide's estimate is not in the frame",
    ]


def test_several_logs_and_datasets(log, tmp_path):
    attempt(log, frame(0))
    lmo = {"epos": [("lmo-1", pose(), 0.9)]}
    with AttemptLog.open(tmp_path / "other.db") as other:
        attempt(other, frame(1, decision(1, object_name="lmo-1"), estimates=lmo))
        out = recorded([log, other])
        again = recorded([log, log, other], objects=["lmo-1"])
    assert sorted(out.inputs.results) == ["lmo", "ycbv"]
    assert out.outcomes.sort("dataset")["dataset"].to_list() == ["lmo", "ycbv"]
    assert again.outcomes["dataset"].to_list() == ["lmo"]


def test_a_copy_of_a_log_beside_it_counts_once(log):
    attempt(log, frame(0), frame(1))
    assert len(recorded([log, log]).outcomes) == 2
    assert len(recorded([log, log]).inputs.results["ycbv"]["epos"]) == 2


def test_a_log_without_outcomes_is_refused(log):
    log.add([frame(0)])
    with pytest.raises(MismatchError, match="holds no outcome of a grasp that an estimator guided"):
        recorded([log])

import numpy as np
import pytest

import ros_messages as ros
from episode_world import CAMERAS, FOUND, NAMES, World, new_world
from graspcast.errors import UnknownNameError
from graspcast.ros.judging import StreamJudge
from graspcast.ros.settings import Settings
from graspcast.runtime.frame import Estimate, Frame
from graspcast.runtime.watcher import Watcher

OBJECTS = {"first": "d-1", "second": "d-2"}
START = 1_700_000_000.0


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return new_world(tmp_path_factory.mktemp("world"))


@pytest.fixture
def watcher(world: World) -> Watcher:
    return Watcher(world.forecaster, models=world.models, threshold=0.7)


def stream(watcher: Watcher, **given) -> StreamJudge:
    settings = Settings(ros.CAMERA, **({"objects": OBJECTS} | given))
    return StreamJudge(watcher, settings)


def at(time_s: float) -> int:
    return round((START + time_s) * ros.NS)


def put(judge: StreamJudge, time_s: float, *, image=0, names=NAMES, now_s=None) -> None:
    """Add both objects of an image by each estimator."""
    for name in names:
        found = [ros.detection(label, FOUND[name][image, k]) for k, label in enumerate(OBJECTS)]
        message = ros.detections(START + time_s, *found)
        judge.add_detections(name, message, at(time_s if now_s is None else now_s))


def expected(watcher: Watcher, *, image=0, names=NAMES, world_T_cam=None, time_s=0.0, episode=None):
    estimates = {
        name: [Estimate(o, FOUND[name][image, k], 0.9) for k, o in enumerate(OBJECTS.values())]
        for name in names
    }
    return watcher.judge(Frame(estimates, world_T_cam, time_s=START + time_s), episode)


def told(answer):
    return [(d.object_name, d.action, d.probability, d.guide, d.views) for d in answer]


def test_the_verdicts_are_the_watchers_on_the_same_frame(watcher):
    judge = stream(watcher)
    put(judge, 0.0)
    (judged,) = judge.due(at(0.0))
    assert told(judged.answer) == told(expected(watcher)) and len(judged.answer) == 2
    assert judged.stamp == at(0.0) and not judged.missing
    assert (judge.frames, judge.judged) == (1, 1) and not judge.problems


def test_a_missing_estimator_is_named_and_the_rest_is_judged_after_the_timeout(watcher):
    judge = stream(watcher)
    put(judge, 0.0, names=NAMES[:1])
    assert judge.due(at(0.4)) == []
    (judged,) = judge.due(at(0.6))
    assert judged.missing == list(NAMES[1:])
    assert told(judged.answer) == told(expected(watcher, names=NAMES[:1]))
    assert f"image without a message by {NAMES[1]}" in judge.problems.counts()


def test_a_transform_that_comes_late_is_waited_for_and_one_that_never_comes_is_said(watcher):
    judge = stream(watcher, world_frame=ros.BASE)
    judge.add_transforms(ros.Message(transforms=[transform(0, -0.1)]))
    put(judge, 0.0)
    assert judge.due(at(0.0)) == []
    judge.add_transforms(ros.Message(transforms=[transform(0, 0.1)]))
    (judged,) = judge.due(at(0.1))
    assert judged.answer.decisions[0].world_T_obj is not None
    put(judge, 1.0)
    assert judge.due(at(1.5)) == []
    (judged,) = judge.due(at(2.1))
    assert judged.answer is None
    assert any("without the camera's pose in the world" in line for line in judged.problems.lines())
    assert (judge.frames, judge.judged) == (2, 1)


def transform(camera: int, time_s: float):
    return ros.transform(ros.BASE, ros.CAMERA, CAMERAS[camera], START + time_s)


def test_frames_of_a_static_scene_are_looks_until_a_new_scene(watcher):
    judge = stream(watcher, world_frame=ros.BASE, episodes="static")
    answers = []
    for look in range(3):
        judge.add_transforms(ros.Message(transforms=[transform(look, look)]))
        if look == 2:
            judge.new_scene()
        put(judge, look, image=look)
        (judged,) = judge.due(at(look))
        answers.append(judged.answer)
    assert [answer.look for answer in answers] == [1, 2, 1]
    assert answers[0].episode == answers[1].episode != answers[2].episode
    first = expected(watcher, world_T_cam=CAMERAS[0])
    second = expected(watcher, image=1, world_T_cam=CAMERAS[1], time_s=1.0, episode=first.episode)
    assert told(answers[1]) == told(second) and answers[1].decisions[0].views == 2


def test_single_frames_are_scenes_of_their_own(watcher):
    judge = stream(watcher)
    put(judge, 0.0)
    put(judge, 1.0)
    first, second = judge.due(at(1.0))
    assert first.answer.look == second.answer.look == 1
    assert first.answer.episode != second.answer.episode


def test_an_expired_scene_begins_anew(world):
    watcher = Watcher(world.forecaster, models=world.models, threshold=0.7, max_episodes=1)
    judge = stream(watcher, world_frame=ros.BASE, episodes="static")
    for look in range(2):
        judge.add_transforms(ros.Message(transforms=[transform(look, look)]))
        put(judge, look, image=look)
        (judged,) = judge.due(at(look))
        assert judged.answer.look == 1
        expected(watcher)  # takes the only place
    assert judge.problems.counts() == {"scene that expired: a new one begins": 1}


def test_a_clock_that_is_set_back_forgets_what_came_before(watcher):
    judge = stream(watcher)
    put(judge, 100.0, names=NAMES[:1])
    put(judge, 0.0, now_s=100.1)
    (judged,) = judge.due(at(100.1))
    assert judged.stamp == at(0.0) and judge.rest() == []
    assert "stamp far in the past: what came before is forgotten" in judge.problems.counts()


def test_what_still_waits_is_judged_at_the_end(watcher):
    judge = stream(watcher)
    put(judge, 0.0, names=NAMES[:1])
    put(judge, 1.0)
    assert [judged.stamp for judged in judge.rest()] == [at(0.0), at(1.0)]
    assert judge.rest() == []


def test_bad_estimates_are_never_attempted_and_an_empty_image_is_judged(watcher):
    judge = stream(watcher)
    for name in NAMES:
        judge.add_detections(name, ros.detections(START), at(0.0))
        bad = [
            ros.detection("first", ros.at(np.nan, 0, 1)),
            ros.detection("second", ros.at(0, 0, 600.0)),  # millimetres
        ]
        judge.add_detections(name, ros.detections(START + 1, *bad), at(1.0))
    empty, bad = judge.due(at(1.0))
    assert len(empty.answer) == 0
    assert [d.attempt for d in bad.answer] == [False]
    assert "mm" in bad.answer.decisions[0].reason or "millimetres" in bad.answer.decisions[0].reason


def test_unknown_objects_and_estimators_are_refused_at_the_start(watcher):
    with pytest.raises(UnknownNameError, match="'d-9'"):
        stream(watcher, objects={"box": "d-9"})
    settings = Settings(ros.CAMERA)
    with pytest.raises(UnknownNameError, match=r"'sam'.*known: "):
        StreamJudge(watcher, settings, ["sam"])

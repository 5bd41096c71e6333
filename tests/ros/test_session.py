from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace as Message

import numpy as np
import pytest

import ros_messages as ros
from episode_world import FOUND, NAMES, new_world
from graspcast.attempt_log.log import AttemptLog
from graspcast.errors import GraspcastError, InputError
from graspcast.forecasting.forecaster import Forecaster
from graspcast.guarantees.certify import certify
from graspcast.ros.diagnostics import OK, WARN
from graspcast.ros.parameters import node_settings
from graspcast.ros.session import Session


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("world")
    new_world(folder).forecaster.save(folder / "model.npz")
    return folder / "model.npz"


def session(model: Path, **more) -> Session:
    given = {
        "model": [str(model)],
        "threshold": 0.0,
        "estimates": [f"{name}=/{name}" for name in NAMES],
        "objects": ["mug=d-1"],
        "camera_frame": ros.CAMERA,
    }
    return Session(node_settings(given | more))


def judged(running: Session, time_s: float):
    for name in NAMES:
        found = ros.detection("mug", FOUND[name][0, 0])
        running.judge.add_detections(name, ros.detections(time_s, found), round(time_s * ros.NS))
    (one,) = running.judge.due(round(time_s * ros.NS))
    return one


def test_it_says_what_it_judges(model):
    running = session(model, world_frame="base")
    said = running.summary()
    assert f"{NAMES[0]} on /{NAMES[0]}" in said and said.endswith("world frame base")
    running.close()


def test_decisions_and_outcomes_are_logged(model, tmp_path):
    path = tmp_path / "log.db"
    running = session(model, attempt_log=str(path))
    (decision,) = judged(running, 10.0).answer
    running.outcome(Message(decision=decision.id, success=False, reason="dropped"))
    with pytest.raises(GraspcastError):
        running.outcome(Message(decision="unknown", success=False, reason=""))
    with pytest.raises(InputError, match="another process writes"):
        session(model, attempt_log=str(path))
    running.close()
    (row,) = AttemptLog.read(path).table().iter_rows(named=True)
    assert row["id"] == decision.id and row["success"] is False and row["source"] == "node"
    session(model, attempt_log=str(path)).close()


def test_without_a_log_an_outcome_is_refused(model):
    running = session(model)
    with pytest.raises(InputError, match="log"):
        running.outcome(Message(decision="x", success=True, reason=""))
    running.close()


def test_a_log_that_was_opened_is_closed_where_the_rest_fails(model, tmp_path):
    path = str(tmp_path / "log.db")
    with pytest.raises(GraspcastError):
        session(model, attempt_log=path, objects=["mug=d-99"])
    session(model, attempt_log=path).close()


def test_states_are_of_what_is_new(model):
    running = session(model)
    assert [s.level for s in running.statuses()] == [WARN]  # nothing has come
    judged(running, 10.0)
    assert [s.level for s in running.statuses()] == [OK]
    unknown = ros.detections(11.0, ros.detection("box", FOUND[NAMES[0]][0, 0]))
    for name in NAMES:
        running.judge.add_detections(name, unknown, 11 * ros.NS)
    running.judge.due(11 * ros.NS)
    (status,) = running.statuses()
    assert status.level == WARN and "unknown class" in status.message
    assert [s.level for s in running.statuses()] == [OK]
    running.close()


def test_diagnostics_say_what_the_monitor_of_a_guarantee_says(model, tmp_path):
    found = certify(np.full(40, 0.95), np.ones(40, bool), np.arange(40), rate=0.9, confidence=0.9)
    card = Forecaster.load(model).card
    stated = {"model": card.digest, "ood_alpha": 0.01}
    replace(found, policy=None, provenance=stated).save(tmp_path / "c.json")
    given = {"certificate": [str(tmp_path / "c.json")], "threshold": -1.0, "max_looks": 1}
    running = session(model, attempt_log=str(tmp_path / "log.db"), **given)
    (decision,) = judged(running, 10.0).answer
    running.outcome(Message(decision=decision.id, success=True, reason=""))

    def make(type_name, /, **fields):
        return Message(type_name=type_name, **fields)

    array = running.diagnostics(make, 10 * ros.NS, "node")
    assert [s.name for s in array.status] == ["node: judging", "node: guarantee"]
    assert "no alarm" in array.status[1].message
    running.close()

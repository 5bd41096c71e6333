"""A recorded trial as a scene that moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from graspcast.simulation.trial.recording import Recording
from graspcast.simulation.trial.trial import TrialRunner
from graspcast.viewing.trial_scene import trial_scene


def test_the_trial_is_played_from_the_first_state_to_the_last(
    runner: TrialRunner, held: Recording
) -> None:
    scene = trial_scene(held, runner.grasp_object, runner.gripper, "a cube")
    motion = scene.motion
    assert motion is not None and scene.title.startswith("a cube gripper: held")
    assert (np.diff(motion.times_s) > 0).all() and motion.times_s[0] == 0
    assert_allclose(motion.times_s[-1], held.states[-1].time_s - held.states[0].time_s)
    assert_allclose(motion.scene_T_node["object"][0], held.states[0].sim_T_obj, atol=1e-9)
    assert_allclose(motion.scene_T_node["object"][-1], held.states[-1].sim_T_obj, atol=1e-9)
    assert list(dict.fromkeys(motion.captions)) == ["approach", "close", "lift"]
    assert len(motion.captions) == len(motion.times_s)
    moving = {node.name for node in scene.nodes} - {"table", "estimate"}
    assert moving == set(motion.scene_T_node) and "hand/left_finger" in moving


def test_the_estimate_is_where_it_was_and_only_if_it_can_be_told_from_the_object(
    runner: TrialRunner, held: Recording
) -> None:
    given = runner.grasp_object, runner.gripper, "a cube"
    nodes = {node.name: node for node in trial_scene(held, *given).nodes}
    assert_allclose(nodes["estimate"].scene_T_node, held.sim_T_est)
    assert nodes["estimate"].shape.opacity < 1
    assert nodes["object"].about["success"] is True
    perfect = replace(held, sim_T_est=held.states[0].sim_T_obj)
    assert "estimate" not in {node.name for node in trial_scene(perfect, *given).nodes}


def test_a_trial_of_one_state_has_a_scene(runner: TrialRunner, held: Recording) -> None:
    still = replace(held, states=held.states[:1])
    scene = trial_scene(still, runner.grasp_object, runner.gripper, "a cube")
    assert scene.motion is not None and len(scene.motion.times_s) == 1

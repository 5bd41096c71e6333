"""The node with rclpy itself: transitions, topics, tf, verdicts, outcomes, diagnostics."""

import time

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2: see docs/ros.md")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from graspcast_msgs.msg import Outcome, Verdict, VerdictArray  # noqa: E402
from graspcast_ros.node import Judge, make  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.lifecycle import TransitionCallbackReturn  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402
from vision_msgs.msg import Detection3DArray  # noqa: E402

import ros_messages as ros  # noqa: E402
from episode_world import CAMERAS, FOUND, NAMES, new_world  # noqa: E402
from graspcast.ros.parameters import PARAMETERS  # noqa: E402
from graspcast.runtime.frame import Estimate, Frame  # noqa: E402
from graspcast.runtime.watcher import Watcher  # noqa: E402

OBJECTS = {"mug": "d-1", "bowl": "d-2"}
SUCCESS = TransitionCallbackReturn.SUCCESS


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("world")
    world = new_world(folder)
    world.forecaster.save(folder / "model.npz")
    return folder / "model.npz"


@pytest.fixture
def context():
    rclpy.init()
    yield
    rclpy.shutdown()


class Probe(Node):
    """Sends what estimators and robots send, and keeps what the node sends."""

    def __init__(self):
        super().__init__("probe")
        self.verdicts, self.found, self.states = [], [], []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.senders = {n: self.create_publisher(Detection3DArray, f"/{n}", 10) for n in NAMES}
        self.tf = self.create_publisher(TFMessage, "/tf", 100)
        self.tf_static = self.create_publisher(TFMessage, "/tf_static", latched)
        self.outcomes = self.create_publisher(Outcome, "/graspcast/outcome", 10)
        self.new_scene = self.create_client(Trigger, "/graspcast/new_scene")
        subscribe = self.create_subscription
        subscribe(VerdictArray, "/graspcast/verdicts", self.verdicts.append, 10)
        subscribe(Detection3DArray, "/graspcast/detections", self.found.append, 10)
        subscribe(DiagnosticArray, "/diagnostics", self.states.append, 10)

    def header(self, time_s, frame=ros.CAMERA):
        ns = round(time_s * ros.NS)
        stamp = make("builtin_interfaces/msg/Time", sec=ns // ros.NS, nanosec=ns % ros.NS)
        return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def detect(self, name, image, time_s):
        detections = []
        for k, label in enumerate(OBJECTS):
            pose = ros.pose(FOUND[name][image, k])
            pose = make(
                "geometry_msgs/msg/Pose",
                position=make("geometry_msgs/msg/Point", **vars(pose.position)),
                orientation=make("geometry_msgs/msg/Quaternion", **vars(pose.orientation)),
            )
            result = make(
                "vision_msgs/msg/ObjectHypothesisWithPose",
                hypothesis=make("vision_msgs/msg/ObjectHypothesis", class_id=label, score=0.9),
                pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose),
            )
            detections.append(make("vision_msgs/msg/Detection3D", results=[result]))
        message = Detection3DArray(header=self.header(time_s), detections=detections)
        self.senders[name].publish(message)

    def move(self, sender, parent, child, matrix, time_s):
        given = ros.transform(parent, child, matrix).transform
        transform = make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", **vars(given.translation)),
            rotation=make("geometry_msgs/msg/Quaternion", **vars(given.rotation)),
        )
        header = self.header(time_s, parent)
        stamped = TransformStamped(header=header, child_frame_id=child, transform=transform)
        sender.publish(TFMessage(transforms=[stamped]))


@pytest.fixture
def running(context, model, tmp_path):
    """Return a function that starts the node with further parameters, and a probe."""
    executor = SingleThreadedExecutor()
    probe = Probe()
    executor.add_node(probe)
    nodes = []

    def start(**changes):
        given = {
            "model": [str(model)],
            "threshold": 0.7,
            "estimates": [f"{name}=/{name}" for name in NAMES],
            "objects": [f"{label}={name}" for label, name in OBJECTS.items()],
            "camera_frame": ros.CAMERA,
            "diagnostics_period_s": 0.2,
        }
        overrides = [Parameter(n, value=v) for n, v in (given | changes).items()]
        node = Judge(parameter_overrides=overrides)
        executor.add_node(node)
        nodes.append(node)
        return node, probe, lambda ready, wait_s=10.0: spin(executor, ready, wait_s)

    yield start
    for node in nodes:
        node.destroy_node()
    probe.destroy_node()
    executor.shutdown()


def spin(executor, ready, wait_s):
    """Spin until something is so; say whether it came to be."""
    end = time.monotonic() + wait_s
    while time.monotonic() < end and not ready():
        executor.spin_once(timeout_sec=0.05)
    return ready()


def matched(node, probe):
    """Whether publishers and subscriptions have found each other."""
    heard = all(s.get_subscription_count() for s in (*probe.senders.values(), probe.tf))
    return heard and probe.count_publishers("/graspcast/verdicts") > 0


def activate(node, probe, until):
    assert node.trigger_configure() == SUCCESS
    assert node.trigger_activate() == SUCCESS
    assert until(lambda: matched(node, probe))


def test_parameters_are_declared_with_their_descriptions(running):
    node, _, _ = running()
    for parameter in PARAMETERS:
        described = node.describe_parameter(parameter.name)
        assert described.description == parameter.description


def test_verdicts_are_the_watchers_and_follow_the_stamps(running, model):
    node, probe, until = running()
    activate(node, probe, until)
    for image in range(2):
        for name in NAMES:
            probe.detect(name, image, 100.0 + image)
    assert until(lambda: len(probe.verdicts) == 2 and len(probe.found) == 2)
    watcher = Watcher.load(model, threshold=0.7)
    for image, array in enumerate(probe.verdicts):
        estimates = {
            n: [Estimate(o, FOUND[n][image, k], 0.9) for k, o in enumerate(OBJECTS.values())]
            for n in NAMES
        }
        answer = watcher.judge(Frame(estimates, time_s=100.0 + image))
        assert array.header.stamp.sec == 100 + image and not array.missing
        assert len(array.verdicts) == len(answer) == 2
        actions = {"attempt": Verdict.ATTEMPT, "abstain": Verdict.ABSTAIN}
        actions["look again"] = Verdict.LOOK_AGAIN
        for verdict, decision in zip(array.verdicts, answer, strict=True):
            assert verdict.action == actions[decision.action]
            assert verdict.probability == pytest.approx(decision.probability)
        scores = [d.results[0].hypothesis.score for d in probe.found[image].detections]
        assert scores == [v.probability for v in array.verdicts]


def test_a_missing_estimator_is_waited_for_and_named(running):
    node, probe, until = running(timeout_s=0.2)
    activate(node, probe, until)
    probe.detect(NAMES[0], 0, 100.0)
    assert until(lambda: probe.verdicts)
    assert probe.verdicts[0].missing == list(NAMES[1:])
    assert until(lambda: any(s.level == b"\x01" for m in probe.states for s in m.status), 5.0)


def test_transforms_come_from_tf_and_static_ones_are_latched(running):
    node, probe, until = running(world_frame=ros.BASE)
    probe.move(probe.tf_static, "hand", ros.CAMERA, np.eye(4), 0.0)
    activate(node, probe, until)
    probe.move(probe.tf, ros.BASE, "hand", CAMERAS[0], 99.9)
    for name in NAMES:
        probe.detect(name, 0, 100.0)
    until(lambda: False, 0.3)
    assert not probe.verdicts  # the transform may still come
    probe.move(probe.tf, ros.BASE, "hand", CAMERAS[0], 100.1)
    assert until(lambda: probe.verdicts)
    verdict = probe.verdicts[0].verdicts[0]
    assert verdict.world_pose_known and probe.verdicts[0].world_frame == ros.BASE


def test_a_static_scene_is_looked_at_until_a_new_one_is_called(running):
    node, probe, until = running(world_frame=ros.BASE, episodes="static")
    probe.move(probe.tf_static, "hand", ros.CAMERA, np.eye(4), 0.0)
    activate(node, probe, until)
    for look in range(3):
        if look == 2:
            assert probe.new_scene.wait_for_service(5.0)
            answer = probe.new_scene.call_async(Trigger.Request())
            assert until(answer.done) and answer.result().success
        probe.move(probe.tf, ros.BASE, "hand", CAMERAS[look], 100.0 + look)
        for name in NAMES:
            probe.detect(name, look, 100.0 + look)
        assert until(lambda n=look: len(probe.verdicts) == n + 1)
    assert [array.look for array in probe.verdicts] == [1, 2, 1]


def test_without_activation_nothing_is_judged_and_it_can_start_again(running):
    node, probe, until = running()
    activate(node, probe, until)
    assert node.trigger_deactivate() == SUCCESS
    assert until(lambda: probe.senders[NAMES[0]].get_subscription_count() == 0)
    for name in NAMES:
        probe.detect(name, 0, 100.0)
    until(lambda: False, 0.3)
    assert not probe.verdicts
    assert node.trigger_cleanup() == SUCCESS
    activate(node, probe, until)
    for name in NAMES:
        probe.detect(name, 0, 101.0)
    assert until(lambda: probe.verdicts)
    assert node.trigger_shutdown() == SUCCESS


@pytest.mark.parametrize(
    "changes", [{"model": ["none.npz"]}, {"camera_frame": ""}, {"objects": ["box=d-99"]}]
)
def test_wrong_parameters_fail_the_configuration(running, changes):
    node, _, _ = running(**changes)
    assert node.trigger_configure() != SUCCESS


def test_outcomes_of_attempts_reach_the_log(running, tmp_path):
    node, probe, until = running(attempt_log=str(tmp_path / "log.sqlite"), threshold=0.0)
    activate(node, probe, until)
    for name in NAMES:
        probe.detect(name, 0, 100.0)
    assert until(lambda: probe.verdicts)
    decision = probe.verdicts[0].verdicts[0]
    assert decision.action == Verdict.ATTEMPT
    until(lambda: probe.outcomes.get_subscription_count() > 0)
    probe.outcomes.publish(Outcome(decision=decision.id, success=True))
    from graspcast.attempt_log.log import AttemptLog

    def logged():
        with AttemptLog.read(tmp_path / "log.sqlite") as log:
            return len(log.outcomes()) == 1

    assert until(logged)

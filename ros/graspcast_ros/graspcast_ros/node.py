"""The lifecycle node: wires topics, transforms and parameters to ``graspcast.ros``, no more."""

import sys
from functools import partial
from importlib import import_module

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from graspcast_msgs.msg import Outcome, VerdictArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import Detection3DArray

from graspcast.errors import GraspcastError
from graspcast.ros.outgoing import detection_array, verdict_array
from graspcast.ros.parameters import PARAMETERS, node_settings
from graspcast.ros.session import Session

# Best effort receives from every publisher, reliable or not.
DETECTIONS_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
TF_QOS = QoSProfile(depth=100)
TF_STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OUT_QOS = QoSProfile(depth=10)
DUE_PERIOD_S = 0.02


def make(type_name, /, **fields):
    """Build a message of rclpy: ``make("geometry_msgs/msg/Point", x=1.0, y=2.0, z=3.0)``."""
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)(**fields)


class Judge(LifecycleNode):
    """Estimates and tf in, verdicts out."""

    def __init__(self, **options):
        super().__init__("graspcast", **options)
        for parameter in PARAMETERS:
            descriptor = ParameterDescriptor(description=parameter.description)
            self.declare_parameter(parameter.name, parameter.default, descriptor)
        self._session = None
        self._inputs, self._clocks, self._service = [], [], None

    def on_configure(self, state):
        """Load the models; make what is published."""
        values = {p.name: self.get_parameter(p.name).value for p in PARAMETERS}
        try:
            given = node_settings(values)
            self._session = Session(given)
        except (GraspcastError, OSError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._given = given
        self._verdicts = self.create_lifecycle_publisher(VerdictArray, "~/verdicts", OUT_QOS)
        self._detections = self.create_lifecycle_publisher(
            Detection3DArray, "~/detections", OUT_QOS
        )
        self._diagnostics = self.create_lifecycle_publisher(
            DiagnosticArray, "/diagnostics", OUT_QOS
        )
        self._service = self.create_service(Trigger, "~/new_scene", self._on_new_scene)
        self.get_logger().info(self._session.summary())
        return super().on_configure(state)

    def on_activate(self, state):
        """Listen and judge."""
        subscribe = self.create_subscription
        self._inputs = [
            subscribe(Detection3DArray, topic, partial(self._on_detections, name), DETECTIONS_QOS)
            for name, topic in self._given.topics.items()
        ]
        tf = self._session.judge.add_transforms
        self._inputs += [
            subscribe(TFMessage, "/tf", tf, TF_QOS),
            subscribe(TFMessage, "/tf_static", partial(tf, static=True), TF_STATIC_QOS),
            subscribe(Outcome, "~/outcome", self._on_outcome, OUT_QOS),
        ]
        self._clocks = [
            self.create_timer(DUE_PERIOD_S, self._publish_due),
            self.create_timer(self._given.diagnostics_period_s, self._publish_diagnostics),
        ]
        return super().on_activate(state)

    def on_deactivate(self, state):
        """Stop listening; what waits is not judged."""
        self._stop_listening()
        self._session.judge.clear()
        return super().on_deactivate(state)

    def on_cleanup(self, state):
        """Close the log and forget the models."""
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state):
        """Close all, from whatever state."""
        self._stop_listening()
        self._release()
        return super().on_shutdown(state)

    def _stop_listening(self):
        for timer in self._clocks:
            self.destroy_timer(timer)
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs, self._clocks = [], []

    def _release(self):
        if self._session is None:
            return
        self._session.close()
        self._session = None
        for publisher in (self._verdicts, self._detections, self._diagnostics):
            self.destroy_lifecycle_publisher(publisher)
        self.destroy_service(self._service)

    def _now(self):
        return self.get_clock().now().nanoseconds

    def _on_detections(self, estimator, message):
        self._session.judge.add_detections(estimator, message, self._now())
        self._publish_due()

    def _publish_due(self):
        settings = self._given.settings
        for judged in self._session.judge.due(self._now()):
            self._verdicts.publish(verdict_array(make, judged, settings))
            self._detections.publish(detection_array(make, judged, settings))

    def _publish_diagnostics(self):
        name = self.get_name()
        self._diagnostics.publish(self._session.diagnostics(make, self._now(), name))

    def _on_outcome(self, message):
        try:
            self._session.outcome(message)
        except GraspcastError as error:
            self.get_logger().error(str(error))

    def _on_new_scene(self, request, response):
        self._session.judge.new_scene()
        response.success, response.message = True, "the next frame is the first look at a scene"
        return response


def main(arguments=None):
    """Run the node until it is stopped."""
    rclpy.init(args=arguments)
    node = Judge()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())

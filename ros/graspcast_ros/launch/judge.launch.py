"""Start the node, configured and active.

``ros2 launch graspcast_ros judge.launch.py params:=/path/to/params.yaml``
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition


def generate_launch_description():
    """Return what is launched: the node, and its transitions to active."""
    share = Path(get_package_share_directory("graspcast_ros"))
    params = DeclareLaunchArgument(
        "params",
        default_value=str(share / "config" / "judge.yaml"),
        description="Parameter file of the node",
    )
    node = LifecycleNode(
        package="graspcast_ros",
        executable="judge",
        name="graspcast",
        namespace="",
        output="screen",
        parameters=[LaunchConfiguration("params")],
    )

    def change(transition):
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
        )

    activate = RegisterEventHandler(
        OnStateTransition(
            target_lifecycle_node=node,
            start_state="configuring",
            goal_state="inactive",
            entities=[change(Transition.TRANSITION_ACTIVATE)],
        )
    )
    return LaunchDescription([params, node, activate, change(Transition.TRANSITION_CONFIGURE)])

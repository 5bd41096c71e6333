"""Tests of the node with rclpy: run by ``pytest`` in a workspace that colcon has built."""

import os
import sys
from pathlib import Path

# Nothing leaves this machine.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("ROS_DOMAIN_ID", "77")
sys.path[:0] = [str(Path(__file__).parents[3] / "tests")]

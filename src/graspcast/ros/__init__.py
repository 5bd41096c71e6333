"""ROS messages and bags: frames from detections, and verdicts as detections, without ROS."""

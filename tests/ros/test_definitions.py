from pathlib import Path

from graspcast.ros.bag_types import own_types
from graspcast.ros.definitions import DETECTIONS, GRASPCAST_MSGS, OUTCOME, TRANSFORMS, VERDICTS

FILES = Path(__file__).parents[2] / "ros" / "graspcast_msgs"


def test_our_definitions_are_those_of_the_ros_package():
    files = {f"graspcast_msgs/msg/{p.stem}": p.read_text("utf-8") for p in FILES.glob("msg/*.msg")}
    assert files == GRASPCAST_MSGS
    built = (FILES / "CMakeLists.txt").read_text("utf-8")
    assert all(f'"msg/{path.name}"' in built for path in FILES.glob("msg/*.msg"))


def test_they_serve_in_both_generations_of_ros():
    for ros1 in (True, False):
        types = own_types(ros1=ros1)
        assert {VERDICTS, OUTCOME, DETECTIONS} <= set(types.types)
        assert types.generate_msgdef(VERDICTS, ros_version=1 if ros1 else 2)[0]


def test_messages_of_others_have_the_published_md5_sums_of_ros_1():
    # What ROS 1's tools compare before they read a topic.
    types = own_types(ros1=True)
    sums = {name: types.generate_msgdef(name)[1] for name in (DETECTIONS, TRANSFORMS)}
    assert sums == {
        DETECTIONS: "05c51d9aea1fb4cfdc8effb94f197b6f",
        TRANSFORMS: "94810edda583a504dfda3829e70d7eec",
    }

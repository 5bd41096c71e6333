"""The verb ``rosbag``: verdicts on the estimates in a bag of ROS."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_text
from graspcast.cli.decision_options import add_models, add_robot_policy, add_threshold, watcher_of
from graspcast.cli.options import Verbs, new_verb
from graspcast.cli.progress import progress_bar
from graspcast.io.wording import counted

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``rosbag``."""
    verb = new_verb(
        verbs,
        "rosbag",
        _rosbag,
        "verdicts on the estimates in a bag of ROS",
        "Read a bag of ROS 1 (.bag) or ROS 2 (.db3, .mcap, or a directory) and write one with all\n"
        "its messages and the verdicts on its frames, on two topics: PREFIX/verdicts\n"
        "(graspcast_msgs/VerdictArray) and PREFIX/detections (vision_msgs/Detection3DArray, whose\n"
        "scores are the probability of success). ROS need not be installed. OUT's name chooses\n"
        "the format; a directory gets that of the bag that is read. What is no sane estimate is\n"
        "never attempted; what was left out is counted.",
    )
    verb.add_argument("bag", metavar="BAG", type=Path, help="the bag to read")
    verb.add_argument("target", metavar="OUT", type=Path, help="the bag to write")
    add_models(verb)
    verb.add_argument(
        "--estimates",
        metavar="NAME=TOPIC",
        action="append",
        required=True,
        help="an estimator of the model, and the topic of its vision_msgs/Detection3DArray",
    )
    verb.add_argument(
        "--objects",
        metavar="CLASS=OBJECT",
        action="append",
        default=[],
        help="the object of a class of the detections (mustard=ycbv-5); objects' own names need "
        "none",
    )
    _add_frames(verb)
    add_threshold(verb)
    add_robot_policy(verb)
    verb.add_argument(
        "--prefix",
        metavar="TOPIC",
        default="/graspcast",
        help="of the topics that are added (default: /graspcast)",
    )


def _add_frames(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--camera-frame",
        metavar="FRAME",
        required=True,
        help="the camera's optical frame (x right, y down, z forward); detections in another "
        "frame are transformed by /tf and /tf_static",
    )
    verb.add_argument(
        "--world-frame",
        metavar="FRAME",
        help="a frame that stands still: the camera's pose in it is looked up (default: none)",
    )
    verb.add_argument(
        "--episodes",
        choices=("single", "static"),
        default="single",
        help="single: each frame is judged by itself; static: all are looks at one scene that "
        "stands still, which needs --world-frame (default: single)",
    )
    verb.add_argument(
        "--tolerance-s",
        metavar="S",
        type=float,
        default=0.02,
        help="largest difference of the stamps of one image, seconds; less than half the time "
        "between two images (default: 0.02)",
    )
    verb.add_argument(
        "--timeout-s",
        metavar="S",
        type=float,
        default=0.5,
        help="how long an image waits for estimators that are missing, in the bag's time, seconds "
        "(default: 0.5)",
    )


def _rosbag(options: argparse.Namespace) -> None:
    from graspcast.guarantees.certificate import Certificate
    from graspcast.io.extras import require
    from graspcast.ros.conversion import convert_bag
    from graspcast.ros.parameters import pairs
    from graspcast.ros.settings import Settings

    require("rosbag")
    settings = Settings(
        camera_frame=options.camera_frame,
        world_frame=options.world_frame,
        objects=pairs(options.objects, "objects", "CLASS=OBJECT"),
        tolerance_s=options.tolerance_s,
        timeout_s=options.timeout_s,
        episodes=options.episodes,
    )
    topics = pairs(options.estimates, "estimates")
    certificates = [Certificate.load(path) for path in options.certificate]
    watcher = watcher_of(options, certificates)
    with progress_bar("messages") as move:
        done = convert_bag(
            options.bag,
            options.target,
            watcher,
            topics,
            settings,
            prefix=options.prefix,
            progress=move,
        )
    note(*done.problems.lines())
    actions = ", ".join(f"{n} {action}" for action, n in sorted(done.actions.items())) or "none"
    print_text(
        f"{options.target} ({done.kind}): {counted(done.messages, 'message')} copied; "
        f"{counted(done.frames, 'frame')}, {done.judged} judged; verdicts: {actions}"
    )

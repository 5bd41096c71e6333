"""Bags that tests write: detections of two estimators, tf and a topic of no interest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ros_messages as ros
from graspcast.ros.bag_types import own_types

SUFFIXES = ("bag", "db3", "mcap")
NS = ros.NS
START_S = 1_700_000_000.0
EPOS, GDRNPP = "/epos/detections", "/gdrnpp/detections"
TOPICS = {"epos": EPOS, "gdrnpp": GDRNPP}
NOISE = "/noise"


class Bag:
    """A bag being written, in the format of the suffix; ``""`` and ``"dir"`` are directories."""

    def __init__(self, path: Path, suffix: str, **options):
        self.ros1 = suffix == "bag"
        self.store = own_types(ros1=self.ros1)
        self.path, self._topics = path, {}
        if self.ros1:
            from rosbags.rosbag1 import Writer

            self.writer = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            plugin = StoragePlugin.MCAP if suffix == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer(path, version=8, storage_plugin=plugin)
        for name, value in options.items():
            getattr(self.writer, name)(*value)

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *error):
        self.writer.close() if error[0] is None else self.writer.abort()

    def put(self, topic: str, type_name: str, message, time_s: float) -> None:
        if topic not in self._topics:
            self._topics[topic] = self.writer.add_connection(topic, type_name, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        raw = serialize(message, type_name)
        self.raw(topic, raw, time_s)

    def raw(self, topic: str, raw: bytes, time_s: float) -> None:
        self.writer.write(self._topics[topic], round(time_s * NS), raw)

    def detect(self, topic: str, message, time_s: float) -> None:
        self.put(topic, "vision_msgs/msg/Detection3DArray", self.detections(message), time_s)

    def move(self, time_s: float, *transforms, topic: str = "/tf") -> None:
        make = self.make
        message = make(
            "tf2_msgs/msg/TFMessage",
            transforms=[
                make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(t.header),
                    child_frame_id=t.child_frame_id,
                    transform=make(
                        "geometry_msgs/msg/Transform",
                        translation=make(
                            "geometry_msgs/msg/Vector3", **vars(t.transform.translation)
                        ),
                        rotation=make("geometry_msgs/msg/Quaternion", **vars(t.transform.rotation)),
                    ),
                )
                for t in transforms
            ],
        )
        self.put(topic, "tf2_msgs/msg/TFMessage", message, time_s)

    def make(self, name, **fields):
        return self.store.types[name](**fields)

    def header(self, header):
        more = {"seq": 0} if self.ros1 else {}
        stamp = self.make("builtin_interfaces/msg/Time", **vars(header.stamp))
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=header.frame_id, **more)

    def pose(self, pose):
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", **vars(pose.position)),
            orientation=self.make("geometry_msgs/msg/Quaternion", **vars(pose.orientation)),
        )

    def detections(self, message):
        return self.make(
            "vision_msgs/msg/Detection3DArray",
            header=self.header(message.header),
            detections=[self._detection(d) for d in message.detections],
        )

    def _detection(self, detection):
        make, header = self.make, self.header(detection.header)
        zero = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        results = []
        for result in detection.results:
            pose = make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self.pose(result.pose.pose),
                covariance=np.zeros(36),
            )
            score, name = result.hypothesis.score, result.hypothesis.class_id
            if self.ros1:
                fields = {"id": int(name), "score": score}
            else:
                fields = {
                    "hypothesis": make(
                        "vision_msgs/msg/ObjectHypothesis", class_id=name, score=score
                    )
                }
            results.append(make("vision_msgs/msg/ObjectHypothesisWithPose", pose=pose, **fields))
        box = make(
            "vision_msgs/msg/BoundingBox3D", center=self.pose(ros.pose(np.eye(4))), size=zero
        )
        more = {"source_cloud": self._cloud(header)} if self.ros1 else {"id": ""}
        return make("vision_msgs/msg/Detection3D", header=header, results=results, bbox=box, **more)

    def _cloud(self, header):
        return self.make(
            "sensor_msgs/msg/PointCloud2",
            header=header,
            height=0,
            width=0,
            fields=[],
            is_bigendian=False,
            point_step=0,
            row_step=0,
            data=np.zeros(0, dtype=np.uint8),
            is_dense=True,
        )


def read_bag(path: Path):
    """Return topic, time and message of all messages, by ``rosbags`` itself."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return [
            (c.topic, time, reader.deserialize(raw, c.msgtype))
            for c, time, raw in reader.messages()
        ]

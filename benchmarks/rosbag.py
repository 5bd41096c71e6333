"""Speed of the conversion of bags: messages and frames a second, and memory, in each format.

    python benchmarks/rosbag.py [--frames 1000] [--image-kb 100]

A bag of 10 Hz is made up: three estimators that each see four objects, an image of so many
kilobytes, and tf at 100 Hz. The model is trained on made-up data. The
memory is what the process's peak grew by while it converted, after a first, short bag.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from graspcast import train_forecaster
from graspcast.bop.results import read_results, write_results
from graspcast.estimates.alignment import align
from graspcast.pose.transforms import quaternion
from graspcast.ros.bag_reader import MCAP, ROS1, SQLITE
from graspcast.ros.bag_types import maker_of
from graspcast.ros.bag_writer import BagWriter
from graspcast.ros.conversion import convert_bag
from graspcast.ros.definitions import DETECTIONS, TRANSFORMS
from graspcast.ros.settings import Settings
from graspcast.runtime.watcher import Watcher
from predict import NAMES, made_up_models, made_up_results, made_up_training_data

NS = 1_000_000_000
START = 1_700_000_000 * NS
FORMATS = {"in.bag": ROS1, "in.db3": SQLITE, "in.mcap": MCAP}
CLASSES = {str(k): f"made-{k}" for k in range(1, 5)}


def watcher(folder: Path) -> tuple[Watcher, dict]:
    rng = np.random.default_rng(0)
    models = {"made": made_up_models(folder, rng)}
    tables = made_up_results(rng)
    paths = {name: folder / f"{name}_made-test.csv" for name in tables}
    for name, table in tables.items():
        write_results(paths[name], table)
    read = {name: read_results(path) for name, path in paths.items()}
    estimates = align(read, dataset="made", anchor="first")
    data = made_up_training_data(estimates, rng).select(np.arange(2000))
    forecaster = train_forecaster(data, models=models)
    return Watcher(forecaster, models=models, threshold=0.8), tables


def write(path: Path, kind: str, tables: dict, frames: int, image_kb: int) -> None:
    image = np.zeros(1000 * image_kb, dtype=np.uint8)
    with BagWriter.open(path, kind) as writer:
        make = maker_of(writer.types, ros1=writer.ros1)

        def header(time_ns: int, frame: str) -> object:
            stamp = make("builtin_interfaces/msg/Time", sec=time_ns // NS, nanosec=time_ns % NS)
            return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

        def pose(matrix: np.ndarray) -> object:
            w, *xyz = quaternion(matrix[:3, :3]).tolist()
            return make(
                "geometry_msgs/msg/Pose",
                position=make("geometry_msgs/msg/Point", **_named("xyz", matrix[:3, 3])),
                orientation=make("geometry_msgs/msg/Quaternion", **_named("xyzw", [*xyz, w])),
            )

        def detection(number: int, matrix: np.ndarray, head: object) -> object:
            zero = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
            of = make("vision_msgs/msg/ObjectHypothesis", class_id=str(number), score=0.9)
            there = make(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose(matrix), covariance=np.zeros(36)
            )
            result = make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=of, pose=there)
            box = make("vision_msgs/msg/BoundingBox3D", center=pose(matrix), size=zero)
            return make(
                "vision_msgs/msg/Detection3D", header=head, results=[result], bbox=box, id=""
            )

        topics = {name: writer.add_topic(f"/{name}", DETECTIONS) for name in NAMES}
        tf = writer.add_topic("/tf", TRANSFORMS)
        picture = writer.add_topic("/image", "sensor_msgs/msg/CompressedImage")
        still = make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=1.0),
            rotation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        )
        for frame in range(frames):
            at = START + frame * NS // 10
            for k in range(10):
                now = at + k * NS // 100
                moved = make(
                    "geometry_msgs/msg/TransformStamped",
                    header=header(now, "base"),
                    child_frame_id="camera",
                    transform=still,
                )
                message = make(TRANSFORMS, transforms=[moved])
                writer.write_message(tf, now, message)
            head = header(at, "camera")
            message = make(
                "sensor_msgs/msg/CompressedImage", header=head, format="jpeg", data=image
            )
            writer.write_message(picture, at, message)
            for name, topic in topics.items():
                table, row = tables[name], 4 * frame % len(tables[name])
                seen = [
                    detection(int(table.obj_id[r]), table.cam_T_obj[r], head)
                    for r in range(row, row + 4)
                ]
                message = make(DETECTIONS, header=head, detections=seen)
                writer.write_message(topic, at + NS // 50, message)


def _named(names: str, values: object) -> dict[str, float]:
    return dict(zip(names, np.asarray(values, dtype=float).tolist(), strict=True))


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description="Speed of the conversion of bags.")
    parser.add_argument("--frames", type=int, default=1000, help="images in the bag")
    parser.add_argument("--image-kb", type=int, default=100, help="kilobytes of each image")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        judge, tables = watcher(folder)
        judge.warm_up()
        topics = {name: f"/{name}" for name in NAMES}
        settings = Settings("camera", "base", objects=CLASSES)
        for file, kind in FORMATS.items():
            for label, frames in (("short", 20), ("", args.frames)):
                path, out = folder / file, folder / f"out{Path(file).suffix}"
                write(path, kind, tables, frames, args.image_kb)
                before, start = peak_mb(), time.perf_counter()
                done = convert_bag(path, out, judge, topics, settings)
                took, grown = time.perf_counter() - start, peak_mb() - before
                size = path.stat().st_size / 1e6
                if not label:
                    print(
                        f"{kind}: {done.messages} messages ({size:.0f} MB), {done.judged} frames "
                        f"of {done.frames} judged in {took:.1f} s: {done.messages / took:,.0f} "
                        f"messages/s, {done.judged / took:.0f} frames/s; memory +{grown:.0f} MB"
                    )
                path.unlink(), out.unlink()


if __name__ == "__main__":
    main()

"""The verb ``demo``: from images to verdicts by the other verbs, on images that ship."""

from __future__ import annotations

import argparse
import os
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.demo_looks import (
    LOOKS,
    DemoFiles,
    print_looks,
    save_two_sides,
    some_images,
    told_instance,
)
from graspcast.cli.options import Verbs, new_verb, share
from graspcast.errors import InputError
from graspcast.io.files import write_text

if TYPE_CHECKING:
    from graspcast.bop.dataset import BopDataset

__all__ = ["add"]

_BOXES = "test_detections_jittered.json"
_CASES = "2"
_COUNT = {1: "one look", 2: "up to two looks", 3: "up to three looks"}


def add(verbs: Verbs) -> None:
    """Add the verb ``demo``."""
    verb = new_verb(
        verbs,
        "demo",
        _demo,
        "all of it on rendered images that ship: images in, verdicts and pictures out",
        "Three estimators look at 300 rendered images of 30 tables. Poses are fused over up to\n"
        "three images of a table, and grasps tried in simulation. A forecaster learns on two\n"
        "thirds of the tables, and says on the rest which grasps to attempt, and when to look\n"
        "again. The work is done by other verbs, whose commands are printed. It takes some\n"
        "minutes on two cores, without network or graphics card. Stopped and started again, it\n"
        "keeps its trials.",
    )
    verb.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("graspcast-demo"),
        help="where everything is put (default: graspcast-demo)",
    )
    verb.set_defaults(directories=("out",))
    verb.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        help="tables of your own instead, by graspcast render, of the same objects",
    )
    verb.add_argument(
        "--principal",
        choices=("dense", "direct", "keypoints"),
        default="dense",
        help="which one guides the grasps (default: dense)",
    )
    verb.add_argument("--gripper", metavar="NAME", default="parallel", help="default: parallel")
    verb.add_argument(
        "--threshold",
        metavar="P",
        type=share,
        default=0.8,
        help="attempt at this probability or above it (default: 0.8)",
    )


def _demo(options: argparse.Namespace) -> int:
    from graspcast.bop.dataset import BopDataset
    from graspcast.cli import main
    from graspcast.demo_data import demo_dataset
    from graspcast.simulation.grippers import load_gripper

    began = time.monotonic()
    dataset = BopDataset(options.data) if options.data else demo_dataset()
    data, parts = str(dataset.root), _parts(dataset)
    # What will not do is better said before minutes have passed.
    _check(dataset, load_gripper(options.gripper).name)
    pictures: list[str] = []
    files = DemoFiles(options.out, dataset.name)
    lines = [f"DATA={shlex.quote(data)}"]
    print_text(lines[0])
    for title, command in _steps(options, dataset, *parts):
        told = _told(command, data)
        print_text(f"\n# {title}\n$ graspcast {told}")
        lines += [f"# {title}", f"graspcast {told}"]
        start = time.monotonic()
        if code := main(command):
            return code
        note(f"{time.monotonic() - start:.0f} s")
        if command[-1].endswith(".png"):
            pictures.append(command[-1])
    if picture := save_two_sides(files, dataset, options.principal):
        pictures.append(str(picture))
    print_looks(files, options.principal)
    write_text(files.commands, "\n".join(lines) + "\n")
    if code := _report(files, data):
        return code
    minutes, seconds = divmod(round(time.monotonic() - began), 60)
    print_text(
        f"\n{minutes} min {seconds} s. Pictures: {', '.join(pictures)}\nReport: {files.report}"
    )
    return 0


def _report(files: DemoFiles, data: str) -> int:
    """Write the report of the demonstration's own run, which holds its commands."""
    from graspcast.cli import main

    command = ["report", str(files.out), "--bop", data]
    command += ["--cases", _CASES, "--out", str(files.report)]
    print_text(f"\n# A report to look at, in a browser\n$ graspcast {_told(command, data)}")
    start = time.monotonic()
    code = main(command)
    note(f"{time.monotonic() - start:.0f} s")
    return code


def _told(command: list[str], data: str) -> str:
    """As one would type it, the data's directory by its variable."""
    inside = f"{data}{os.sep}"
    return " ".join(
        '"$DATA"' if text == data
        else f'"$DATA"/{shlex.quote(text[len(inside) :])}' if text.startswith(inside)
        else shlex.quote(text)
        for text in command
    )  # fmt: skip


def _check(dataset: BopDataset, gripper: str) -> None:
    from graspcast.simulation.grasps.table import read_grasps

    boxes, known = dataset.root / _BOXES, read_grasps()
    if not boxes.is_file():
        raise InputError(f"{boxes}: is not there; graspcast render writes it")
    names = [f"{dataset.name}-{number}" for number in sorted(dataset.models.info)]
    if lacking := [name for name in names if (name, gripper) not in known]:
        raise InputError(
            f"{dataset.root}: there is no reference grasp of {', '.join(lacking)} by {gripper}; "
            "the demonstration is of YCB objects, in a directory called ycbv"
        )


def _steps(
    options: argparse.Namespace, dataset: BopDataset, learnt: list[str], unseen: list[str]
) -> Iterator[tuple[str, list[str]]]:
    """Yield the title and command of each step; later ones read what earlier ones wrote."""
    from graspcast.perception import BUILT_IN

    files, gripper, principal = (
        DemoFiles(options.out, dataset.name),
        options.gripper,
        options.principal,
    )
    bop = ["--bop", str(dataset.root)]
    tables = {name: str(files.poses(name)) for name in BUILT_IN}
    mine = [*bop, "--estimates", f"{principal}={tables[principal]}"]
    everyone = [*bop, *(t for n, path in tables.items() for t in ("--estimates", f"{n}={path}"))]
    boxes = str(dataset.root / _BOXES)
    moved = ["--camera-poses", str(dataset.scenes), "--views-from", "all"]
    for name, path in tables.items():
        yield (
            f"Poses by the estimator {name}",
            ["estimate", *bop, "--detections", boxes, "--estimator", name, "--out", path],
        )
    yield "How wrong they are", ["errors", *everyone, "--shape"]
    yield (
        f"Grasps that {principal} guides, tried in simulation",
        ["simulate", *mine, "--gripper", gripper, "--out", str(files.trials(1))],
    )
    for looks in range(2, LOOKS + 1):
        fused = str(files.fused(looks))
        yield (
            f"Poses fused from up to {looks} looks",
            ["fuse", *everyone, *moved, "--principal", principal, "--scenes", *unseen]
            + ["--max-views", str(looks), "--out", fused],
        )
        yield (
            "Grasps that they guide, tried in simulation",
            ["simulate", *bop, "--estimates", f"fused={fused}", "--gripper", gripper]
            + ["--out", str(files.trials(looks))],
        )
    yield (
        "A forecaster of outcomes, from how the estimates of all looks disagree",
        ["train", *everyone, *moved, "--scenes", *learnt, "--principal", principal]
        + ["--gripper", gripper, "--outcomes", str(files.trials(1)), "--folds", "0"]
        + ["--out", str(files.model)],
    )
    threshold = f"{options.threshold:g}"
    for looks in range(1, LOOKS + 1):
        yield (
            f"Verdicts on tables that it has not seen, after {_COUNT[looks]}",
            ["predict", *everyone, *moved, "--scenes", *unseen, "--model", str(files.model)]
            + ["--max-views", str(looks), "--max-looks", str(LOOKS), "--guide", "fused"]
            + ["--threshold", threshold, "--out", str(files.verdicts(looks))],
        )
    tried = [text for n in (1, LOOKS) for text in ("--outcomes", str(files.trials(n)))]
    yield (
        f"What other thresholds would be worth after {_COUNT[LOOKS]}, if a failure is dear",
        ["score", "--verdicts", str(files.verdicts(LOOKS)), *tried, "--cost-fail", "10"]
        + ["--cost-skip", "0.2", "--cost-look", "0.05"],
    )
    yield from _pictures(files, dataset, mine, gripper)


def _pictures(
    files: DemoFiles, dataset: BopDataset, mine: list[str], gripper: str
) -> Iterator[tuple[str, list[str]]]:
    """Yield the steps that draw estimates, and a grasp by one look and by several."""
    images = [text for image in some_images(files) for text in ("--image", image)]
    yield (
        "Estimates (green), the truth (solid) and verdicts after one look",
        ["overlay", *mine, *images, "--verdicts", str(files.verdicts(1))]
        + ["--out", str(files.out / "overlays.png")],
    )
    row = told_instance(files)
    if row is None:
        return
    bop = ["--bop", str(dataset.root), "--estimates"]
    for name, title, poses, est_id in (
        ("one-look", "The grasp after one look, which fails", mine[-1:], "est_id"),
        ("looked-again", "The same after looking again, which holds",
         [f"fused={files.fused(LOOKS)}"], "fused_est_id"),
    ):  # fmt: skip
        yield (
            title,
            ["watch", "--object", f"{dataset.name}-{row['obj_id']}", "--gripper", gripper]
            + [*bop, *poses, "--image", f"{row['scene_id']}/{row['im_id']}"]
            + ["--est-id", str(row[est_id]), "--out", str(files.out / f"{name}.png")],
        )


def _parts(dataset: BopDataset) -> tuple[list[str], list[str]]:
    """Two thirds of the scenes to learn from, and the rest."""
    scenes = sorted({scene for scene, _ in dataset.images})
    if len(scenes) < 3:
        raise InputError(f"{dataset.root}: has {len(scenes)} scenes, but three are needed")
    cut = round(len(scenes) * 2 / 3)
    return _range(scenes[:cut]), _range(scenes[cut:])


def _range(scenes: list[int]) -> list[str]:
    """Scenes as ``--scenes`` takes them."""
    if scenes == list(range(scenes[0], scenes[-1] + 1)):
        return [f"{scenes[0]}-{scenes[-1]}"]
    return list(map(str, scenes))

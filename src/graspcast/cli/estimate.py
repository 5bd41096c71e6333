"""The verb ``estimate``: poses of detected objects."""

from __future__ import annotations

import argparse
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.numbers import number_type
from graspcast.cli.options import (
    Verbs,
    add_out,
    add_sensor,
    maybe_named,
    new_verb,
    positive,
)
from graspcast.cli.progress import progress_bar
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.bop.dataset import BopDataset
    from graspcast.bop.detections import Detections
    from graspcast.bop.results import Results

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``estimate``."""
    verb = new_verb(
        verbs,
        "estimate",
        _estimate,
        "poses of detected objects, by a built-in estimator or any command",
        "Estimate the pose of each detected object and write a BOP results CSV, with a built-in\n"
        "estimator (dense, direct, keypoints), or with any command that writes such a file, in an\n"
        "environment of its own. In the command, {bop}, {detections} and {out} are replaced by\n"
        "the dataset's directory, the detections file and the file to write:\n\n"
        "  --estimator 'other-env/bin/python infer.py --images {bop} --boxes {detections} "
        "--save {out}'",
    )
    verb.add_argument(
        "--bop",
        metavar="DIR",
        type=maybe_named,
        required=True,
        help="BOP dataset directory with images; NAME=DIR if the directory is called otherwise",
    )
    verb.add_argument(
        "--split",
        metavar="NAME",
        help="the split with the images, val or test_primesense (default: test, or the only one "
        "that begins so)",
    )
    add_sensor(verb)
    _add_detections(verb)
    verb.add_argument(
        "--estimator",
        metavar="NAME|COMMAND",
        required=True,
        help="a built-in estimator, or a command",
    )
    verb.add_argument(
        "--weights",
        metavar="FILE",
        type=Path,
        help="your own weights (ONNX) for a built-in estimator",
    )
    verb.add_argument(
        "--timeout",
        metavar="S",
        type=_seconds,
        dest="timeout_s",
        help="stop the command after this time, seconds",
    )
    verb.add_argument(
        "--lenient",
        action="store_true",
        help="skip bad entries and unknown objects, and count them",
    )
    add_out(verb, "the poses (BOP results CSV, METHOD_DATASET-test.csv)")


def _add_detections(verb: argparse.ArgumentParser) -> None:
    """Add ``--detections``, and which of them are used."""
    verb.add_argument(
        "--detections",
        metavar="FILE",
        type=Path,
        required=True,
        help="2D detections, as in the BOP Challenge, of GDRNPP or ZebraPose, or COCO (JSON)",
    )
    verb.add_argument(
        "--min-score", metavar="S", type=float, help="leave out detections with a lower score"
    )
    verb.add_argument(
        "--top",
        metavar="N",
        type=positive,
        help="of each object in an image, the N detections with the highest scores",
    )
    verb.add_argument(
        "--targets",
        metavar="FILE",
        type=Path,
        help="only the objects and images of a targets file (test_targets_bop19.json)",
    )


_seconds = number_type(lambda value: 0 < value < inf, "a number of seconds over 0 is")


def _estimate(options: argparse.Namespace) -> None:
    from graspcast.bop.dataset import BopDataset
    from graspcast.bop.detection_choice import chosen
    from graspcast.bop.detections import read_detections
    from graspcast.bop.targets import read_targets
    from graspcast.perception import BUILT_IN

    name = options.estimator
    is_command = "{" in name or len(name.split()) > 1
    if not is_command and name not in BUILT_IN:
        raise UnknownNameError(
            "estimator",
            name,
            BUILT_IN,
            hint="Other estimators are commands that write to {out}",
        )
    if is_command and options.weights:
        raise InputError("--weights is for a built-in estimator; put them into the command instead")
    if not is_command and options.timeout_s:
        raise InputError(f"--timeout is for a command; {name} is built in")
    dataset_name, root = options.bop
    dataset = BopDataset(root, split=options.split, name=dataset_name, sensor=options.sensor)
    _note_name(options.out, dataset.name)
    detections = read_detections(options.detections, dataset, lenient=options.lenient)
    _note_dropped(detections)
    detections = chosen(
        detections,
        min_score=options.min_score,
        top=options.top,
        targets=read_targets(options.targets) if options.targets else None,
    )
    note(*detections.remarks)
    if detections.detector:
        note(f"{detections.source}: {detections.detector}")
    if not len(detections):
        raise InputError(f"{detections.source}: holds no detection")
    run = _by_command if is_command else _by_built_in
    results = run(options, dataset, detections)
    _note_dropped(results)
    # Late: once polars is loaded, Ctrl-C does not end the wait for a command.
    from graspcast.estimates.consistency import describe_lengths

    note(describe_lengths(dataset.name, dataset, {options.out.name: results.cam_T_obj}))
    asked, answered = (
        set(zip(table.scene_id.tolist(), table.im_id.tolist(), strict=True))
        for table in (detections, results)
    )
    if without := len(asked - answered):
        note(
            f"{without} of {len(asked)} images with detections have no pose; is the file complete?"
        )
    print_text(
        f"{options.out}: {counted(len(results), 'pose')} in {counted(len(answered), 'image')}, "
        f"from {counted(len(detections), 'detection')} in {len(asked)}"
    )


def _by_built_in(
    options: argparse.Namespace, dataset: BopDataset, detections: Detections
) -> Results:
    from graspcast.perception import built_in
    from graspcast.perception.run import run_estimator

    estimator = built_in(options.estimator, options.weights)
    with progress_bar("estimating") as move:
        return run_estimator(
            estimator, dataset, detections, options.out, lenient=options.lenient, progress=move
        )


def _by_command(
    options: argparse.Namespace, dataset: BopDataset, detections: Detections
) -> Results:
    from graspcast.perception.run import run_external

    with progress_bar("the command runs") as move:
        return run_external(
            options.estimator,
            dataset,
            detections,
            options.out,
            timeout_s=options.timeout_s,
            lenient=options.lenient,
            progress=lambda share, line: move(share, line[-60:]),
        )


def _note_name(out: Path, dataset: str) -> None:
    """Say so if the file to write is called as one of another dataset, for which it would pass."""
    from graspcast.bop.file_names import belongs_to

    try:
        belongs_to(out, [dataset])
    except MismatchError:
        note(
            f"{out}: by its name a CSV of another dataset than {dataset}, whose images these are; "
            f"METHOD_{dataset}-SPLIT.csv would say that"
        )


def _note_dropped(table: Detections | Results) -> None:
    for reason, count in table.dropped.items():
        note(f"{table.source}: left out {count} ({reason})")

"""The verb ``convert``: poses as any estimator keeps them, as a BOP results CSV."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import Verbs, add_out, count, maybe_named, new_verb
from graspcast.cli.progress import progress_bar
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from numpy import ndarray

__all__ = ["add"]

_UNITS = ("mm", "cm", "m", "inch")


def add(verbs: Verbs) -> None:
    """Add the verb ``convert``."""
    verb = new_verb(
        verbs,
        "convert",
        _convert,
        "poses as any estimator keeps them, as a BOP results CSV",
        "Write a BOP results CSV from poses as estimators keep them: results CSVs of any layout,\n"
        "SAM-6D's JSON, object data of MegaPose and happypose, FoundationPose's matrices. The\n"
        "form is recognised; what a file does not say is stated by options. Everything is checked\n"
        "first, and nothing is half converted.",
    )
    verb.add_argument(
        "inputs",
        metavar="IN",
        nargs="+",
        type=Path,
        help="a file or directory; several are put together",
    )
    add_out(verb, "the poses (BOP results CSV, METHOD_DATASET-test.csv)")
    verb.set_defaults(positional={"inputs": "IN"})
    verb.add_argument(
        "--scene", metavar="N", type=count, dest="scene_id", help="the scene, if IN has none"
    )
    verb.add_argument(
        "--image", metavar="N", type=count, dest="im_id", help="the image, if IN is of one"
    )
    verb.add_argument(
        "--object",
        metavar="[LABEL=]N",
        type=_object,
        action="append",
        default=[],
        dest="object_numbers",
        help="the number of the object that IN calls LABEL, or of its only object",
    )
    verb.add_argument(
        "--unit",
        choices=_UNITS,
        dest="length_unit",
        help="the unit of translations in IN (default: that of its form)",
    )
    verb.add_argument(
        "--apply",
        metavar="[N=]T",
        type=_transform,
        action="append",
        default=[],
        help="apply a transform on the object's side, cam_T_obj · T, to all poses of object N: 16 "
        "numbers, row by row, the translation in metres, or a JSON file",
    )
    verb.add_argument(
        "--bop",
        metavar="DIR",
        type=maybe_named,
        help="BOP directory whose models the poses must suit; NAME=DIR if it is called otherwise",
    )
    verb.add_argument(
        "--lenient", action="store_true", help="skip bad rows and unknown objects, and count them"
    )


def _object(text: str) -> tuple[str, int]:
    label, _, number = text.rpartition("=")
    if not (number.isascii() and number.isdecimal()):
        raise argparse.ArgumentTypeError(f"NUMBER or LABEL=NUMBER is needed, not {text!r}")
    return label, int(number)


def _transform(text: str) -> tuple[int | None, str]:
    number, equals, rest = text.partition("=")
    if equals and number.strip().isdecimal():
        return int(number), rest
    return None, text


def _convert(options: argparse.Namespace) -> None:
    from graspcast.bop.dataset import BopDataset
    from graspcast.bop.pose_rows import Stated
    from graspcast.bop.results import write_results
    from graspcast.estimates.consistency import describe_lengths
    from graspcast.estimates.conversion import convert_poses

    _refuse_overwriting(options)
    dataset = BopDataset(options.bop[1], name=options.bop[0]) if options.bop else None
    with progress_bar("reading"):
        results = convert_poses(
            options.inputs,
            stated=Stated(
                options.scene_id, options.im_id, dict(options.object_numbers), options.length_unit
            ),
            transforms=_transforms(options),
            dataset=dataset,
            lenient=options.lenient,
        )
    write_results(options.out, results)
    note(*results.remarks)
    note(*(f"{options.out}: dropped {n} rows ({why})" for why, n in results.dropped.items()))
    name = dataset.name if dataset else "without --bop"
    note(describe_lengths(name, dataset, {options.out.name: results.cam_T_obj}))
    images = len(set(zip(results.scene_id.tolist(), results.im_id.tolist(), strict=True)))
    print_text(
        f"{options.out}: {counted(len(results), 'pose')} of "
        f"{counted(len(set(results.obj_id.tolist())), 'object')} in {counted(images, 'image')}"
    )


def _refuse_overwriting(options: argparse.Namespace) -> None:
    """Raise if the output is one of the files in a directory that is read."""
    out = options.out.resolve()
    for path in options.inputs:
        if path.is_dir() and out.parent == path.resolve() and out.exists():
            raise InputError(
                f"{options.out}: is in {path}, which is read; write to another file",
                parameters=("out",),
            )


def _transforms(options: argparse.Namespace) -> Mapping[int | None, ndarray]:
    from graspcast.bop.object_transforms import (
        is_file,
        parse_object_transform,
        read_object_transforms,
    )

    out: dict[int | None, ndarray] = {}
    for number, text in options.apply:
        if is_file(text):
            found = read_object_transforms(text)
            if number is not None:
                if set(found) not in ({None}, {number}):
                    raise InputError(
                        f"{text}: is of several objects, or of another one than {number}",
                        parameters=("apply",),
                    )
                found = {number: next(iter(found.values()))}
        else:
            found = {number: parse_object_transform(text, "transform")}
        for key, value in found.items():
            if key in out:
                raise InputError(
                    f"there are two transforms for object {key}"
                    if key is not None
                    else "there are two transforms for all objects",
                    parameters=("apply",),
                )
            out[key] = value
    return out

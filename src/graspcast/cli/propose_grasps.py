"""The verb ``propose-grasps``: find grasps of an object that succeed under pose errors."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.error_options import add_covariance, add_tails, drawn_errors
from graspcast.cli.numbers import number_type
from graspcast.cli.options import (
    Verbs,
    add_bop,
    add_estimates,
    add_json,
    add_out,
    add_pair,
    bop_dirs_of,
    count,
    new_verb,
    note_sizes,
    positive,
    write_json,
)
from graspcast.cli.progress import progress_bar
from graspcast.cli.protocol_options import add_protocol, settings_of
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from jaxtyping import Float
    from numpy import ndarray

    from graspcast.simulation.campaign.pose_errors import PoseErrors
    from graspcast.simulation.grasps.pose_frames import Frame
    from graspcast.simulation.grasps.proposing import ImportedPoses, ProposedGrasps
    from graspcast.simulation.grasps.table import GraspTable, ReferenceGrasp
    from graspcast.simulation.objects.types import GraspObject

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``propose-grasps``."""
    verb = new_verb(
        verbs,
        "propose-grasps",
        _propose_grasps,
        "find grasps of an object that succeed under pose errors",
        "Propose grasps from an object's mesh, or read them from a file of another program, try\n"
        "them in simulation, and write those that succeed most often under pose errors to a TOML\n"
        "file, the best first. Pose errors are those of estimates with ground truth, drawn from\n"
        "standard deviations or covariances, or drawn with 4 mm across and 10 mm along the\n"
        "viewing ray and 5 degrees. A known grasp of the object is tried too, and kept.",
    )
    add_pair(verb, "ycbv-5")
    verb.add_argument("--catalogue", metavar="FILE", type=Path, help="own objects (TOML)")
    verb.add_argument(
        "--grasps",
        metavar="FILE",
        type=Path,
        help="own grasps (TOML): those of the object by the gripper are tried too",
    )
    add_bop(verb)
    add_estimates(verb, required=False, built_in=True)
    add_covariance(verb, "from which errors are drawn")
    add_tails(verb)
    _add_import(verb)
    add_protocol(verb)
    verb.add_argument(
        "--count", metavar="N", type=positive, default=30, help="grasps to keep (default: 30)"
    )
    verb.add_argument(
        "--budget",
        metavar="X",
        type=_factor,
        default=1.0,
        help="size of the search; 1 is about 2,000 trials (default: 1)",
    )
    verb.add_argument("--seed", metavar="N", type=count, default=0, help="random seed (default: 0)")
    verb.add_argument("--workers", metavar="N", type=positive, help="threads (default: all cores)")
    verb.add_argument("--picture", metavar="FILE", type=Path, help="draw the best ten (.png)")
    add_json(verb)
    add_out(verb, "the TOML file of grasps", others=("picture",))


def _add_import(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--from",
        dest="poses",
        metavar="FILE",
        type=Path,
        help="instead of proposals, grasps of another program: GraspGen's .json, an Isaac grasp\n"
        "file as .json, a .json list of 4x4 matrices, or a .csv of 16 numbers a row, each the\n"
        "hand's pose in the mesh's frame",
    )
    verb.add_argument(
        "--frame",
        choices=("tcp", "base", "graspgen"),
        help="what these are the poses of: the tool centre point, the gripper's base, or the\n"
        "base's origin with z along the approach and x along the closing, as GraspGen has it;\n"
        "checked by simulation (default: graspgen for GraspGen's files, else tcp)",
    )
    verb.add_argument(
        "--closing",
        choices=("x", "y"),
        default="x",
        help="axis of these poses along which the fingers close (default: x; with --frame base\n"
        "it is the model's)",
    )
    verb.add_argument(
        "--unit", choices=("m", "mm"), default="m", help="unit of their positions (default: m)"
    )


_factor = number_type(lambda value: 0.05 <= value <= 100, "a number from 0.05 to 100 is")


def _propose_grasps(options: argparse.Namespace) -> None:
    from graspcast.simulation.grasps.guiding_errors import guiding_errors
    from graspcast.simulation.grasps.proposing import propose_grasps
    from graspcast.simulation.grasps.ranking import Effort
    from graspcast.simulation.grasps.table import grasps_in, read_grasps, write_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.simulation.objects.catalogue import read_catalogue
    from graspcast.simulation.objects.load import load_object

    if options.picture is not None and options.picture.suffix.lower() != ".png":
        raise InputError(f"{options.picture}: a picture is a .png file", parameters=("picture",))
    written = grasps_in(options.out) if options.out.exists() else []  # so that bad files are found
    errors, bop_dirs = _errors_of(options)
    gripper = load_gripper(options.gripper)
    target = load_object(
        options.object, bop_dirs=bop_dirs, catalogue=read_catalogue(options.catalogue)
    )
    known = _known(
        read_grasps(options.grasps, protocol=options.protocol), target.name, gripper.name
    )
    if known:
        target = known[0].applied_to(target)
    note_sizes([target], [gripper])
    guiding = guiding_errors(target, errors, seed=options.seed)
    note(f"pose errors: {guiding.told}")
    imported = _imported(options)
    with progress_bar("proposing") as move:
        found = propose_grasps(
            target,
            gripper,
            guiding.obj_T_est,
            count=options.count,
            seed=options.seed,
            effort=Effort().scaled(options.budget),
            settings=settings_of(options, gripper),
            symmetries=_symmetries(target, bop_dirs),
            known=[reference.grasp for reference in known],
            poses=imported,
            workers=options.workers,
            progress=move,
        )
    entries = _entries(found, known, guiding.told)
    _print(found, {reference.grasp.name for reference in known})
    if written:
        written = grasps_in(options.out)  # which another process may have changed
    pair = (target.name, gripper.name)
    others = [r for r in written if (r.grasp.object, r.grasp.gripper) != pair]
    write_grasps(options.out, [*others, *entries])
    told = f"{options.out}: {counted(len(entries), 'grasp')}"
    print_text(told + (f", beside {len(others)} of other pairs" if others else ""))
    write_json(options.json, _as_dict(found, guiding.told))
    if options.picture is not None:
        _draw(options, target, gripper, entries)


def _errors_of(options: argparse.Namespace) -> tuple[PoseErrors | None, dict[str, Path]]:
    """Return the errors that the options ask for, None for the default; and BOP directories."""
    drawn = drawn_errors(options)
    if not options.estimates:
        return drawn, bop_dirs_of(options)
    from graspcast.cli.built_in_estimates import with_built_in
    from graspcast.estimates.loading import load_inputs
    from graspcast.simulation.campaign.pose_errors import PoseErrors

    files = with_built_in(options)
    inputs = load_inputs(
        files.estimates, bop=files.bop, ground_truth=files.ground_truth, sensor=options.sensor
    )
    note(*inputs.notes, *inputs.lengths)
    dirs = {name: dataset.root for name, dataset in inputs.datasets.items()}
    return PoseErrors.of_estimates(inputs.results, inputs.datasets), bop_dirs_of(options) | dirs


def _known(table: GraspTable, name: str, gripper: str) -> list[ReferenceGrasp]:
    """Return the known grasps of the pair; their mass and friction must agree.

    Raises
    ------
    InputError
        If they do not.
    """
    found = list(table.of(name, gripper)) if (name, gripper) in table else []
    if len({(reference.mass_kg, reference.friction) for reference in found}) > 1:
        raise InputError(
            f"the known grasps of {name} by {gripper} have different masses or frictions; grasps "
            "that are compared need the same",
            parameters=("grasps",),
        )
    for reference in found[:1]:
        parts = [
            f"{what} {value:g}{unit}"
            for what, value, unit in (
                ("a mass of", reference.mass_kg, " kg"),
                ("a friction of", reference.friction, ""),
            )
            if value is not None
        ]
        if parts:
            note(f"{' and '.join(parts)}, as for the known grasp of {name} by {gripper}")
    return found


def _imported(options: argparse.Namespace) -> ImportedPoses | None:
    from graspcast.simulation.grasps.pose_files import read_grasp_poses
    from graspcast.simulation.grasps.pose_frames import PoseFrame
    from graspcast.simulation.grasps.proposing import ImportedPoses

    if options.poses is None:
        if options.frame is not None or options.closing != "x" or options.unit != "m":
            raise InputError(
                "frame, closing and unit are those of grasps from a file; name the file",
                parameters=("poses",),
            )
        return None
    poses = read_grasp_poses(options.poses)
    usual: Frame = "graspgen" if poses.form == "GraspGen" else "tcp"
    read_as = PoseFrame(options.frame or usual, options.closing, options.unit)
    note(
        *poses.notes, f"{options.poses}: {counted(len(poses), 'grasp')}, read as {read_as.words()}"
    )
    return ImportedPoses(poses, read_as)


def _symmetries(target: GraspObject, bop_dirs: dict[str, Path]) -> Float[ndarray, "s 4 4"] | None:
    """Return the symmetries of ``models_info.json``; without it, those of the shape."""
    from graspcast.bop.models import read_models_info

    dataset, _, number = target.name.rpartition("-")
    listed = bop_dirs.get(dataset, Path()) / "models" / "models_info.json"
    if dataset in bop_dirs and number.isdecimal() and listed.is_file():
        info = read_models_info(listed).get(int(number))
        if info is not None:
            return info.symmetries
    from graspcast.simulation.grasps.diversity import shape_symmetries

    found, told = shape_symmetries(target)
    if len(found) > 1:
        note(f"grasps that differ by a symmetry of the shape are the same: {told}")
    return found


def _entries(
    found: ProposedGrasps, known: list[ReferenceGrasp], errors: str
) -> list[ReferenceGrasp]:
    """Return the entries of the file; known grasps keep what is known about them."""
    from dataclasses import replace

    own = {reference.grasp.name: reference for reference in known}
    physics = {"mass_kg": known[0].mass_kg, "friction": known[0].friction} if known else {}
    return [
        replace(own[entry.grasp.name], agreement=entry.agreement)
        if entry.grasp.name in own
        else entry
        for entry in found.as_references(errors, **physics)
    ]


_SHOWN = 10


def _print(found: ProposedGrasps, known: set[str]) -> None:
    rows = []
    for number, (grasp, ranked) in enumerate(zip(found.grasps, found.ranked, strict=True)):
        figures = found.figures(number)
        if number >= _SHOWN and grasp.name not in known:
            continue
        survived = [figures.get(f"survived_rms_{axis}_mm", "-") for axis in "xyz"]
        rows.append(
            [
                grasp.name,
                f"{ranked.rate:.2f} [{ranked.interval[0]:.2f}, {ranked.interval[1]:.2f}]",
                str(len(ranked.success)),
                f"{ranked.held} of {ranked.of}",
                " ".join(map(str, survived)),
                ranked.origin,
            ]
        )
    grasp = found.grasps[0]
    print_table(
        f"Grasps of {grasp.object} by {grasp.gripper}, the best {min(_SHOWN, len(rows))} of "
        f"{len(found.grasps)}",
        ["grasp", "success under error", "trials", "true pose", "survived x y z, mm", "found as"],
        rows,
    )
    reasons = ", ".join(f"{number} {reason}" for reason, number in found.reasons.most_common())
    print_text(f"{found.tried} grasps tried in {found.trials} trials; at the true pose {reasons}")


def _as_dict(found: ProposedGrasps, errors: str) -> dict[str, Any]:
    return {
        "object": found.grasps[0].object,
        "gripper": found.grasps[0].gripper,
        "errors": errors,
        "seed": found.seed,
        "tried": found.tried,
        "trials": found.trials,
        "rejected": dict(found.rejected),
        "at_true_pose": dict(found.reasons),
        "grasps": [
            {"name": grasp.name, "obj_T_grasp": grasp.obj_T_grasp.tolist()} | found.figures(number)
            for number, grasp in enumerate(found.grasps)
        ],
    }


def _draw(
    options: argparse.Namespace,
    target: GraspObject,
    gripper: Any,
    entries: list[ReferenceGrasp],
) -> None:
    from graspcast.cli.options import note_software_drawing
    from graspcast.rendering.trials.contact_sheet import draw_grasps, save_sheet

    note_software_drawing()
    shown = entries[:_SHOWN]
    size = 320
    with progress_bar("drawing") as move:
        cells = draw_grasps(
            target, gripper, shown, settings=settings_of(options, gripper), size=size, progress=move
        )
    labels = [
        (entry.grasp.name, f"{float(entry.agreement['success_under_error']):.0%} under error")
        for entry in shown
    ]
    save_sheet(options.picture, labels, [gripper.name], cells, size=size)
    print_text(str(options.picture))

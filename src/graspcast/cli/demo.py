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
from graspcast.cli.options import Verbs, new_verb, share
from graspcast.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from graspcast.bop.dataset import BopDataset

__all__ = ["add"]

_IMAGES = 2
_BOXES = "test_detections_jittered.json"
_SEED = 0


def add(verbs: Verbs) -> None:
    """Add the verb ``demo``."""
    verb = new_verb(
        verbs,
        "demo",
        _demo,
        "all of it on rendered images that ship: images in, verdicts and pictures out",
        "Three estimators look at 300 rendered images of 30 tables; grasps that one of them\n"
        "guides are tried in simulation; a forecaster learns on two thirds of the tables from how\n"
        "the others disagree with it, and says on the rest which grasps to attempt. Everything is\n"
        "done by other verbs, whose commands are printed. It takes some minutes on two cores, and\n"
        "neither network nor graphics card. Stopped and started again, it keeps its trials.",
    )
    verb.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("graspcast-demo"),
        help="where everything is put (default: graspcast-demo)",
    )
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
    verb.add_argument(
        "--gripper", metavar="NAME", default="underactuated", help="default: underactuated"
    )
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
    from graspcast.rendering.opengl_context import import_mujoco

    import_mujoco()
    from graspcast.simulation.grippers import load_gripper

    began = time.monotonic()
    dataset = BopDataset(options.data) if options.data else demo_dataset()
    data, parts = str(dataset.root), _parts(dataset)
    # What will not do is better said before minutes have passed.
    _check(dataset, load_gripper(options.gripper).name)
    pictures: list[str] = []
    print_text(f"DATA={shlex.quote(data)}")
    for title, command in _steps(options, dataset, *parts):
        print_text(f"\n# {title}\n$ graspcast {_told(command, data)}")
        start = time.monotonic()
        if code := main(command):
            return code
        note(f"{time.monotonic() - start:.0f} s")
        if command[-1].endswith(".png"):
            pictures.append(command[-1])
    minutes, seconds = divmod(round(time.monotonic() - began), 60)
    print_text(f"\n{minutes} min {seconds} s. Pictures: {', '.join(pictures)}")
    return 0


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

    out, gripper, principal = options.out, options.gripper, options.principal
    trials, model, verdicts = out / "trials", out / "model.npz", out / "verdicts.csv"
    tables = {name: out / f"{name}_{dataset.name}-test.csv" for name in BUILT_IN}
    bop = ["--bop", str(dataset.root)]
    mine = [*bop, "--estimates", f"{principal}={tables[principal]}"]
    everyone = [*bop, *(t for n, path in tables.items() for t in ("--estimates", f"{n}={path}"))]
    boxes = str(dataset.root / _BOXES)
    for name, path in tables.items():
        yield (
            f"Poses by the estimator {name}",
            ["estimate", *bop, "--detections", boxes, "--estimator", name, "--out", str(path)],
        )
    yield "How wrong they are", ["errors", *everyone, "--shape"]
    yield (
        f"Grasps that {principal} guides, tried in simulation",
        ["simulate", *mine, "--gripper", gripper, "--out", str(trials)],
    )
    yield (
        "A forecaster of their outcomes, from how the others disagree",
        ["train", *everyone, "--scenes", *learnt, "--principal", principal, "--gripper", gripper]
        + ["--outcomes", str(trials), "--folds", "0", "--out", str(model)],
    )
    yield (
        "Verdicts on tables that it has not seen",
        ["predict", *everyone, "--scenes", *unseen, "--model", str(model)]
        + ["--threshold", f"{options.threshold:g}", "--out", str(verdicts)],
    )
    seen = _with_outcomes(verdicts, trials)
    images = [text for image in _some_images(seen) for text in ("--image", image)]
    yield (
        "Estimates (green), the truth (solid) and verdicts in some of the images",
        ["overlay", *mine, *images, "--verdicts", str(verdicts), "--out", f"{out}/overlays.png"],
    )
    for name, title, row in _two_grasps(seen):
        yield (
            title,
            ["watch", "--object", f"{dataset.name}-{row['obj_id']}", "--gripper", gripper, *mine]
            + ["--image", f"{row['scene_id']}/{row['im_id']}", "--est-id", str(row["est_id"])]
            + ["--out", f"{out}/{name}.png"],
        )
    yield (
        "What following the verdicts is worth, on tables that training has not seen",
        ["score", "--verdicts", str(verdicts), "--outcomes", str(trials)],
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


def _with_outcomes(verdicts: Path, trials: Path) -> pl.DataFrame:
    """Return verdicts with outcomes, in an order drawn at random from a seed."""
    from graspcast.estimates.outcomes import TRIAL_COLUMNS, read_outcomes
    from graspcast.evaluation.verdict_scores import with_outcomes
    from graspcast.forecasting.verdict_file import read_verdicts

    both = with_outcomes(read_verdicts(verdicts), read_outcomes(trials))
    ordered = both.sort(*TRIAL_COLUMNS)
    return ordered.sample(fraction=1.0, shuffle=True, seed=_SEED)


def _some_images(seen: pl.DataFrame) -> list[str]:
    """Return the first images in which one grasp is attempted and another one is not."""
    import polars as pl

    mixed = seen.filter(pl.col("attempt").n_unique().over("scene_id", "im_id") > 1)
    images = (mixed if len(mixed) else seen).unique(["scene_id", "im_id"], maintain_order=True)
    return [f"{s}/{i}" for s, i in images.select("scene_id", "im_id").head(_IMAGES).iter_rows()]


def _two_grasps(seen: pl.DataFrame) -> Iterator[tuple[str, str, dict[str, object]]]:
    """Yield the most probable attempted grasp that held, and one not attempted that fails."""
    for attempt, name, title in (
        (True, "attempted", "A grasp that is attempted, and holds"),
        (False, "abstained", "A grasp that is abstained from, and would have failed"),
    ):
        rows = seen.filter(attempt=attempt, success=int(attempt)).drop_nulls("probability")
        if len(rows):
            yield name, title, rows.sort("probability", descending=True).row(0, named=True)

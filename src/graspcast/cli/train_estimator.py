"""The verb ``train-estimator``: the built-in estimators, for other objects."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import note, print_table, print_text
from graspcast.cli.options import Verbs, add_out, count, new_verb, positive
from graspcast.cli.progress import progress_bar

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``train-estimator``."""
    verb = new_verb(
        verbs,
        "train-estimator",
        _train_estimator,
        "train the built-in estimators for other objects, from their models",
        "Render training images of objects, train the built-in estimators on them, measure their\n"
        "errors on rendered images that they were not trained on, and write weights (ONNX) with a\n"
        "model card. The same command goes on with what was interrupted: a kill loses at most a\n"
        "minute of training, or 80 rendered images. Needs PyTorch: pip install "
        "'graspcast[train]'.",
    )
    verb.add_argument(
        "--models", metavar="DIR", type=Path, required=True, help="BOP directory of models"
    )
    verb.add_argument(
        "--work",
        metavar="DIR",
        type=Path,
        required=True,
        help="directory of training images and checkpoints, from which the work goes on",
    )
    verb.add_argument(
        "--dataset",
        metavar="NAME",
        help="name of the objects' dataset (default: of the directory that holds models/)",
    )
    verb.add_argument(
        "--objects", metavar="N", type=int, nargs="+", default=[], help="only these object ids"
    )
    verb.add_argument(
        "--estimator",
        metavar="NAME",
        nargs="+",
        default=["dense", "direct", "keypoints"],
        help="which to train (default: dense direct keypoints)",
    )
    verb.add_argument(
        "--images", metavar="N", type=positive, default=6400, help="to train on (default: 6400)"
    )
    verb.add_argument(
        "--steps",
        metavar="N",
        type=positive,
        default=20_000,
        help="batches of 32 crops (default: 20000); more can be asked for later",
    )
    _add_choices(verb)
    add_out(verb, "directory of the weights, NAME.onnx, and model cards, NAME.md", directory=True)


def _add_choices(verb: argparse.ArgumentParser) -> None:
    """Add options that few need."""
    verb.add_argument(
        "--validation-images",
        metavar="N",
        type=positive,
        default=80,
        help="to measure errors on (default: 80)",
    )
    verb.add_argument("--seed", metavar="N", type=count, default=1, help="random seed (default: 1)")
    verb.add_argument(
        "--strength",
        metavar="X",
        type=float,
        default=0.3,
        help="of image augmentation (default: 0.3; 1 for photographs)",
    )
    verb.add_argument(
        "--device",
        metavar="auto|cpu|cuda",
        default="auto",
        help="auto (the default) takes a GPU if PyTorch sees one",
    )
    verb.add_argument(
        "--threads",
        metavar="N",
        type=count,
        default=0,
        help="default: half of the cores",
    )


def _train_estimator(options: argparse.Namespace) -> None:
    from graspcast.io.extras import require

    require("train")
    from graspcast.pose.lengths import shown
    from graspcast.training.card import HEADER
    from graspcast.training.objects import Objects
    from graspcast.training.run import train_estimators
    from graspcast.training.settings import TrainingSettings
    from graspcast.training.validation import in_words

    settings = TrainingSettings(
        estimators=tuple(options.estimator),
        images=options.images,
        steps=options.steps,
        validation_images=options.validation_images,
        seed=options.seed,
        strength=options.strength,
        device=options.device,
        threads=options.threads,
    )
    objects = Objects.read(options.models, options.objects, options.dataset)
    sizes = (f"{i} ({shown(objects.models[i].diameter_m)} across)" for i in objects.ids)
    note(f"dataset {objects.dataset}, objects {', '.join(sizes)}")
    trained = train_estimators(objects, options.work, options.out, settings, stages=progress_bar)
    for one in trained:
        title = f"{one.estimator} after {one.steps:,} steps: errors on images not trained on"
        print_table(title, HEADER, in_words(one.errors, objects.dataset))
        print_text(f"{one.path}: use --estimator {one.estimator} --weights {one.path}")

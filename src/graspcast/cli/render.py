"""The verb ``render``: synthetic images with ground truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli.console import print_text
from graspcast.cli.options import Verbs, add_out, new_verb
from graspcast.cli.progress import progress_bar
from graspcast.io.wording import counted

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``render``."""
    verb = new_verb(
        verbs,
        "render",
        _render,
        "render a synthetic BOP dataset of objects on tables",
        "Simulate objects and clutter that fall on a table, and render the table from random\n"
        "views in random light: a BOP dataset with images, ground truth, visibility, cameras,\n"
        "targets and models. The objects are those of any BOP directory of models, or six of the\n"
        "YCB set with procedural colours.",
    )
    verb.add_argument(
        "--models",
        metavar="DIR",
        type=Path,
        help="BOP directory of models (models_info.json, obj_000001.ply …); by default six "
        "YCB objects",
    )
    verb.add_argument(
        "--objects",
        metavar="N",
        type=int,
        nargs="+",
        default=[],
        help="restrict to these object ids",
    )
    verb.add_argument(
        "--scenes", metavar="N", type=int, default=20, help="number of tables (default: 20)"
    )
    verb.add_argument(
        "--images", metavar="N", type=int, default=10, help="images of each table (default: 10)"
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="random seed (default: 0)")
    verb.add_argument(
        "--split", metavar="NAME", default="test", help="name of the split (default: test)"
    )
    verb.add_argument(
        "--format",
        metavar="jpg|png|webp",
        default="jpg",
        help="format of the images (default: jpg)",
    )
    verb.add_argument(
        "--quality",
        metavar="N",
        type=int,
        default=85,
        help="quality of jpg and webp, 1 to 100 (default: 85)",
    )
    add_out(verb, "the dataset's directory; its name becomes the dataset's name", directory=True)


def _render(options: argparse.Namespace) -> None:
    from graspcast.io.files import temporary_directory
    from graspcast.rendering.synthetic.dataset import RenderSettings, render_dataset
    from graspcast.rendering.synthetic.paint import write_painted_models

    settings = RenderSettings(
        options.scenes, options.images, options.seed, options.format, options.quality
    )
    with temporary_directory(options.out.parent) as scratch:
        models = options.models
        if models is None:
            models = scratch / "models"
            write_painted_models(models)
        with progress_bar("rendering") as move:
            render_dataset(
                models,
                options.out,
                settings,
                obj_ids=options.objects,
                split=options.split,
                progress=move,
            )
    print_text(f"{options.out}: {counted(settings.scenes * settings.images, 'image')}")

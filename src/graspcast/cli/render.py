"""The verb ``render``: images with ground truth."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from graspcast.cli.console import print_text, progress_bar
from graspcast.cli.options import Verbs, add_out, new_verb

__all__ = ["add"]


def add(verbs: Verbs) -> None:
    """Add the verb ``render``."""
    verb = new_verb(
        verbs,
        "render",
        _render,
        "images of cluttered tables with ground truth, as a BOP dataset",
        "Drop objects and clutter on a table, let physics bring them to rest, and render the\n"
        "table from many sides in varied light: a BOP dataset with ground truth, visibility,\n"
        "cameras, targets and models. The objects are those of any BOP directory of models, or\n"
        "six of the YCB set, painted by rule.",
    )
    verb.add_argument(
        "--models",
        metavar="DIR",
        type=Path,
        help="BOP directory of models (models_info.json, obj_000001.ply …); if left out, painted "
        "YCB objects",
    )
    verb.add_argument(
        "--objects", metavar="N", type=int, nargs="+", default=[], help="only these, by number"
    )
    verb.add_argument("--scenes", metavar="N", type=int, default=20, help="tables (default: 20)")
    verb.add_argument(
        "--images", metavar="N", type=int, default=10, help="of each table (default: 10)"
    )
    verb.add_argument("--seed", metavar="N", type=int, default=0, help="(default: 0)")
    verb.add_argument("--split", metavar="NAME", default="test", help="(default: test)")
    verb.add_argument(
        "--format", metavar="jpg|png|webp", default="jpg", help="of the images (default: jpg)"
    )
    verb.add_argument(
        "--quality", metavar="N", type=int, default=85, help="of jpg and webp (default: 85)"
    )
    add_out(verb, "the dataset's directory; its name is the dataset's")


def _render(options: argparse.Namespace) -> None:
    from graspcast.rendering.opengl_context import import_mujoco

    import_mujoco()
    from graspcast.rendering.synthetic.dataset import RenderSettings, render_dataset
    from graspcast.rendering.synthetic.paint import write_painted_models

    settings = RenderSettings(
        options.scenes, options.images, options.seed, options.format, options.quality
    )
    with tempfile.TemporaryDirectory() as scratch:
        models = options.models
        if models is None:
            models = Path(scratch) / "models"
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
    print_text(f"{options.out}: {settings.scenes * settings.images} images")

"""Options that several verbs share, spelt the same everywhere."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspcast.cli.built_in_estimates import named, named_or_built_in, with_built_in
from graspcast.cli.console import note
from graspcast.cli.numbers import number_type
from graspcast.errors import InputError

if TYPE_CHECKING:
    from numpy import ndarray

    from graspcast.estimates.alignment import Estimates
    from graspcast.estimates.loading import Inputs
    from graspcast.simulation.grippers.protocol import Gripper
    from graspcast.simulation.objects.types import GraspObject

__all__ = [
    "Verbs",
    "add_bop",
    "add_estimates",
    "add_images",
    "add_inputs",
    "add_json",
    "add_ood_alpha",
    "add_out",
    "add_outcomes",
    "add_pair",
    "add_sensor",
    "add_tables",
    "bop_dirs_of",
    "check_outputs",
    "count",
    "field_size",
    "inputs_of",
    "inputs_with_images",
    "maybe_named",
    "new_verb",
    "note_sizes",
    "note_software_drawing",
    "positive",
    "scene_and_image",
    "share",
    "write_json",
]

Verbs = Any  # argparse's sub-parsers action has no public name


def new_verb(
    verbs: Verbs,
    name: str,
    run: Callable[[argparse.Namespace], int | None],
    help_text: str,
    description: str,
) -> argparse.ArgumentParser:
    """Add a verb; ``description`` may have several paragraphs, and ``run`` give an exit code."""
    verb: argparse.ArgumentParser = verbs.add_parser(
        name,
        help=help_text,
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.set_defaults(run=run)
    return verb


def maybe_named(text: str) -> tuple[str | None, Path]:
    """Parse ``NAME=PATH`` or a path alone."""
    name = text.partition("=")[0]
    # A path may hold an equals sign; a name is none, and a directory that is there is meant.
    path_alone = "=" not in text or "/" in name or Path(text).is_dir()
    return (None, Path(text)) if path_alone else named(text)


def add_estimates(verb: argparse.ArgumentParser, *, required: bool, built_in: bool = False) -> None:
    """``--estimates``; ``built_in`` accepts the word that stands for the shipped tables too."""
    verb.add_argument(
        "--estimates",
        metavar="NAME=FILE",
        type=named_or_built_in if built_in else named,
        action="append",
        default=[],
        required=required,
        help="an estimator's BOP results CSV; several of one estimator are put together"
        + ("; built-in: those of the built-in estimators on the shipped tables" * built_in),
    )


def add_bop(verb: argparse.ArgumentParser) -> None:
    """``--bop``, ``--ground-truth``, ``--sensor``."""
    verb.add_argument(
        "--bop",
        metavar="DIR",
        type=maybe_named,
        action="append",
        default=[],
        help="BOP dataset directory with models; NAME=DIR if the directory is called otherwise",
    )
    verb.add_argument(
        "--ground-truth",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="scene folders with scene_gt.json, if not in the split of the BOP directory that the "
        "estimates are of (test/)",
    )
    add_sensor(verb)


def add_sensor(verb: argparse.ArgumentParser) -> None:
    """``--sensor``."""
    verb.add_argument(
        "--sensor",
        metavar="NAME",
        help="which camera's, where a BOP directory holds the images of several (cam1: "
        "scene_gt_cam1.json, rgb_cam1)",
    )


def add_inputs(
    verb: argparse.ArgumentParser, *, bop_required: bool = False, required: bool = True
) -> None:
    """Options that name estimates and their datasets, and which of them are wanted."""
    add_estimates(verb, required=required, built_in=True)
    add_bop(verb)
    verb.set_defaults(bop_required=bop_required)
    verb.add_argument(
        "--objects", metavar="ID", nargs="+", default=[], help="only these (5, or lmo-5)"
    )
    verb.add_argument(
        "--scenes", metavar="N", nargs="+", default=[], type=_scenes, help="only these (3, or 3-8)"
    )
    verb.add_argument(
        "--lenient", action="store_true", help="skip bad rows and unknown objects, and count them"
    )


def inputs_of(
    options: argparse.Namespace, *, every_object: bool = False, without_models: bool = False
) -> Inputs:
    """Load what the options of :func:`add_inputs` name."""
    from graspcast.estimates.loading import load_inputs

    files = with_built_in(options)
    if options.bop_required and not files.bop:
        raise InputError(
            "models and ground truth are needed: give the BOP directory of the estimates",
            parameters=("bop",),
        )
    return load_inputs(
        files.estimates,
        bop=files.bop,
        ground_truth=files.ground_truth,
        objects=[] if every_object else options.objects,
        scenes=sorted(set().union(*options.scenes)),
        lenient=options.lenient,
        sensor=options.sensor,
        without_models=without_models,
    )


def add_images(verb: argparse.ArgumentParser) -> None:
    """``--images``."""
    verb.add_argument(
        "--images",
        action="store_true",
        help="one estimator alone: also look how well its projected models fit the images in the "
        "BOP directories (SCENE/rgb), about 10 ms an instance",
    )


def inputs_with_images(options: argparse.Namespace, *, used: bool = True) -> Inputs:
    """Load what :func:`inputs_of` does, with image fit where ``--images`` asks for it.

    Objects without a model are left out, with a note: they stop nobody else's verdicts.

    Parameters
    ----------
    options
        With those of :func:`add_inputs` and :func:`add_images`.
    used
        Whether the model can use images; if not, a note says so.
    """
    from dataclasses import replace

    from graspcast.cli.progress import progress_bar

    inputs = inputs_of(options, without_models=True)
    if not options.images:
        return inputs
    if not used:
        note("--images makes no difference: no model was trained with one estimator and images")
        return inputs

    found: dict[str, Mapping[str, ndarray]] = {}

    def with_fit(estimates: Estimates) -> Estimates:
        from graspcast.forecasting.model_card import digest_of
        from graspcast.rendering.image_fit import with_image_fit

        # Verdicts after each look ask for the same poses again.
        if (which := digest_of(estimates)) not in found:
            with progress_bar("image fit") as move:
                fitted = with_image_fit(estimates, inputs.datasets, inputs.notes, progress=move)
            found[which] = fitted.seen
        return replace(estimates, seen={**found[which], **estimates.seen})

    return replace(inputs, image_fit=with_fit)


_MOST_SCENES = 1_000_000


def _scenes(text: str) -> range:
    first, dash, last = text.partition("-")
    if first.isdecimal() and (last.isdecimal() if dash else True):
        found = range(int(first), int(last if dash else first) + 1)
        if 0 < len(found) <= _MOST_SCENES:
            return found
    raise argparse.ArgumentTypeError(f"a number or FIRST-LAST (3-8) is needed, not {text!r}")


def positive(text: str) -> int:
    """Parse a whole number from 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"a whole number, 1 or more, is needed, not {text!r}")
    return int(text)


share = number_type(lambda value: 0 <= value <= 1, "a number between 0 and 1 is")
"""Parse a number between 0 and 1."""


def field_size(text: str) -> int:
    """Pixels on a side of a sheet's field."""
    if not text.isdecimal() or not 64 <= int(text) <= 2048:
        raise argparse.ArgumentTypeError(f"64 to 2048 pixels are needed, not {text!r}")
    return int(text)


def scene_and_image(text: str) -> tuple[int, int]:
    """``SCENE/IMAGE``."""
    parts = text.split("/")
    if len(parts) != 2 or not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"SCENE/IMAGE is needed, for example 2/3, not {text!r}")
    return int(parts[0]), int(parts[1])


def add_ood_alpha(verb: argparse.ArgumentParser, what: str) -> None:
    """``--ood-alpha P``; a certificate is valid only for verdicts with the same."""
    # graspcast.forecasting.novelty.OOD_ALPHA, to name which would load NumPy for every --help.
    verb.add_argument("--ood-alpha", metavar="P", type=share, default=0.01, help=what)


def add_out(
    verb: argparse.ArgumentParser,
    what: str,
    *,
    directory: bool = False,
    others: tuple[str, ...] = (),
) -> None:
    """``--out PATH``, required: a file, or a directory; ``others`` name further files written."""
    verb.add_argument("--out", metavar="PATH", type=Path, required=True, help=what)
    verb.set_defaults(directories=("out",) if directory else (), outputs=others)


def add_outcomes(
    verb: argparse.ArgumentParser,
    *,
    required: bool,
    what: str = "trial outcomes: CSV, Parquet, or a campaign's directory; may be repeated",
) -> None:
    """``--outcomes FILE``, which may be repeated."""
    verb.add_argument(
        "--outcomes",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        required=required,
        help=what,
    )


def add_json(verb: argparse.ArgumentParser) -> None:
    """``--json FILE``."""
    verb.add_argument("--json", metavar="FILE", type=Path, help="write the figures as JSON too")


def write_json(path: Path | None, content: Any) -> None:
    """Write figures where ``--json`` said, if it did."""
    if path is None:
        return
    from graspcast.io import json

    json.write_json(path, content)


def bop_dirs_of(options: argparse.Namespace) -> dict[str, Path]:
    """Return the BOP directories that ``--bop`` names, by dataset."""
    return {name or root.resolve().name: root for name, root in options.bop}


def note_sizes(objects: Iterable[GraspObject] = (), grippers: Iterable[Gripper] = ()) -> None:
    """Say the sizes, masses and densities of objects, and the openings of grippers, in one line."""
    from graspcast.pose.lengths import shown
    from graspcast.simulation.objects.plausibility import describe_object

    parts = [f"{o.name} {describe_object(o)}" for o in {o.name: o for o in objects}.values()]
    parts += [f"{g.name} gripper opens to {shown(g.max_opening_m)}" for g in grippers]
    note("; ".join(parts))


def note_software_drawing() -> None:
    """Say so where pictures are drawn without OpenGL."""
    from graspcast.rendering.backend import why_software

    if reason := why_software():
        note(f"drawn in software; with OpenGL it would be quicker, but {reason}")


def add_pair(verb: argparse.ArgumentParser, example: str) -> None:
    """Add ``--object`` and ``--gripper``, one of each."""
    verb.add_argument("--object", metavar="NAME", required=True, help=f"for example {example}")
    verb.add_argument(
        "--gripper", metavar="NAME", required=True, help="name, or the .toml file of a custom one"
    )


def add_tables(verb: argparse.ArgumentParser) -> None:
    """Add ``--grasps``, ``--catalogue`` and ``--collision``."""
    verb.add_argument("--grasps", metavar="FILE", type=Path, help="own reference grasps (TOML)")
    verb.add_argument("--catalogue", metavar="FILE", type=Path, help="own objects (TOML)")
    verb.add_argument(
        "--collision", action="store_true", help="draw the collision pieces, not the mesh"
    )


def count(text: str) -> int:
    """Parse a whole number from 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"a whole number, 0 or more, is needed, not {text!r}")
    return int(text)


_OUTPUTS = ("out", "json", "state", "covariances")


def check_outputs(options: argparse.Namespace) -> None:
    """Raise unless every file that is written can be, and is another than those that are read.

    A verb names further files in ``outputs``, and in ``directories`` what is no file.

    Raises
    ------
    InputError
        Naming the file and the options.
    """
    from graspcast.io.files import check_target

    outputs = (*_OUTPUTS, *getattr(options, "outputs", ()))
    written: dict[Path, str] = {}
    for name in outputs:
        path = getattr(options, name, None)
        if path is None:
            continue
        if (other := written.setdefault(path.resolve(), name)) != name:
            both = f"--{other} and as --{name}".replace("_", "-")
            raise InputError(f"{path}: is given as {both}")
    for name, value in vars(options).items():
        for path in _paths(value) if name not in outputs else ():
            if path.resolve() in written and path.is_file():
                option = f"--{name.replace('_', '-')}"
                option = getattr(options, "positional", {}).get(name, option)
                raise InputError(
                    f"{path}: is read ({option}) and would be replaced "
                    f"(--{written[path.resolve()].replace('_', '-')}); write to another file"
                )
    for name in written.values():
        if name not in getattr(options, "directories", ()):
            check_target(getattr(options, name), name)


def _paths(value: Any) -> list[Path]:
    """Return the paths in an option's value, which may be a list of named ones."""
    if isinstance(value, Path):
        return [value]
    return (
        [path for part in value for path in _paths(part)] if isinstance(value, list | tuple) else []
    )

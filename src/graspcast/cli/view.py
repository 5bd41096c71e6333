"""The verb ``view``: a scene or a trial to turn in a browser, or as a .glb file."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.built_in_estimates import with_built_in
from graspcast.cli.console import note, print_text
from graspcast.cli.numbers import number_type
from graspcast.cli.one_trial import add_trial, record
from graspcast.cli.options import Verbs, new_verb
from graspcast.cli.progress import progress_bar, waiting
from graspcast.errors import InputError
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from graspcast.bop.dataset import BopDataset
    from graspcast.bop.results import Results
    from graspcast.simulation.grippers.protocol import Gripper
    from graspcast.viewing.image_scene import Grasps
    from graspcast.viewing.scene import Scene

__all__ = ["add"]

_FUSED = "fused"
_OF_TRIAL = ("offset", "full", "contact_force", "collision")
_OF_SCENE = ("objects", "fused", "covariances", "verdicts", "ranked_grasps")


_deviations = number_type(
    lambda value: 0 < value <= 1000, "a number of standard deviations above zero, at most 1000, is"
)


def _port(text: str) -> int:
    """Parse the number of a port."""
    if not (text.isdecimal() and int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"a port from 0 to 65535 is needed, not {text!r}")
    return int(text)


def add(verbs: Verbs) -> None:
    """Add the verb ``view``."""
    verb = new_verb(
        verbs,
        "view",
        _view,
        "a scene or a trial to turn, in a browser or as a .glb file",
        "Show what was seen in an image (--bop, --image): the truth, estimates, fused poses with\n"
        "the ellipsoid of two standard deviations of their position, and open hands at the grasps\n"
        "of verdicts, coloured by their probability. Or play a trial (--object, --gripper), with\n"
        "the options of watch.\n\n"
        "It is served to browsers on this machine until Ctrl-C (extra view), or written as a .glb\n"
        "file (--out), which needs no extra: glTF 2.0 in metres with y up, a trial as an\n"
        "animation.",
    )
    add_trial(verb, built_in=True)
    verb.add_argument("--objects", metavar="ID", nargs="+", default=[], help="only these")
    verb.add_argument(
        "--lenient", action="store_true", help="skip bad rows and unknown objects, and count them"
    )
    _add_files(verb)
    verb.add_argument(
        "--object", metavar="NAME", help="play a trial of this object, for example lmo-5"
    )
    verb.add_argument(
        "--gripper",
        metavar="NAME",
        help="the trial's, by name or the .toml file of a custom one; without a trial, the .toml "
        "file of a custom one that verdicts name",
    )
    verb.add_argument("--out", metavar="PATH", type=Path, help="write a .glb file instead")
    verb.add_argument(
        "--host",
        metavar="ADDRESS",
        default="127.0.0.1",
        help="to listen at (default: 127.0.0.1, for browsers on this machine alone); anyone who "
        "reaches another address can look",
    )
    verb.add_argument(
        "--port", metavar="N", type=_port, default=8080, help="default: 8080; 0 takes a free one"
    )


def _add_files(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--fused", metavar="FILE", type=Path, help="what fuse wrote: the fused poses")
    verb.add_argument(
        "--covariances",
        metavar="FILE",
        type=Path,
        help="what fuse --covariances wrote, for ellipsoids",
    )
    verb.add_argument(
        "--ellipsoid-sd",
        metavar="N",
        type=_deviations,
        default=2.0,
        help="standard deviations from the middle of an ellipsoid to its surface (default: 2)",
    )
    verb.add_argument(
        "--verdicts", metavar="FILE", type=Path, help="what predict wrote, for grasps"
    )
    verb.add_argument(
        "--ranked-grasps",
        metavar="FILE",
        type=Path,
        help="what predict --grasps-out wrote: also the other grasps of these instances",
    )


def _view(options: argparse.Namespace) -> None:
    if options.out is not None and options.out.suffix.lower() != ".glb":
        raise InputError(f"{options.out}: a scene is written to .glb", parameters=("out",))
    if options.out is None:
        from graspcast.io.extras import require

        require("view")
    scene = _image(options) if options.object is None else _trial(options)
    if options.out is not None:
        from graspcast.viewing.glb import write_glb

        write_glb(options.out, scene)
        print_text(f"{options.out}: {scene.title}, {counted(len(scene.nodes), 'node')}")
        return
    from graspcast.viewing.server import ViewServer

    with _ends_on_signals(), ViewServer(scene, host=options.host, port=options.port) as server:
        print_text(f"{scene.title}: {server.url}")
        _flush()
        note("Ctrl-C ends it")
        with waiting():
            server.wait()


@contextmanager
def _ends_on_signals() -> Iterator[None]:
    """End the work inside on Ctrl-C, and on SIGTERM, without an error."""
    import signal

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        note("ended")
    finally:
        signal.signal(signal.SIGTERM, before)


def _flush() -> None:
    """Write out what was printed, for programs that wait for the address."""
    import sys

    sys.stdout.flush()


def _trial(options: argparse.Namespace) -> Scene:
    from graspcast.viewing.trial_scene import trial_scene

    _refuse(options, _OF_SCENE, "is of a scene: leave out --object, or this")
    if options.gripper is None:
        raise InputError("a trial needs --gripper too")
    trial = record(options)
    grasp_object, gripper = trial.runner.grasp_object, trial.runner.gripper
    return trial_scene(
        trial.recording, grasp_object, gripper, trial.title, collision=options.collision
    )


def _image(options: argparse.Namespace) -> Scene:
    from graspcast.viewing.image_scene import Seen, image_scene
    from graspcast.views.covariance_table import read_covariances

    _refuse(options, _OF_TRIAL, "is of a trial: give --object and --gripper too, or leave it out")
    if options.image is None:
        raise InputError(
            "give --image SCENE/IMAGE and --bop for what was seen in an image, or --object and "
            "--gripper for a trial"
        )
    if options.covariances is not None and options.fused is None:
        raise InputError("--covariances are of fused poses: give --fused too")
    if options.ranked_grasps is not None and options.verdicts is None:
        raise InputError("--ranked-grasps are of instances with verdicts: give --verdicts too")
    dataset, results = _inputs(options)
    table = None if options.covariances is None else read_covariances(options.covariances)
    # The file of fused poses goes through the same checks as those of estimators.
    fused = results.pop(_FUSED, None)
    seen = Seen(results, fused, table, _grasps(options, dataset), options.ellipsoid_sd)
    wanted = [text if "-" in text else f"{dataset.name}-{text}" for text in options.objects]
    with progress_bar("building the scene"):
        scene = image_scene(dataset, options.image, seen, objects=wanted)
    for option, group in (("fused", "fused"), ("verdicts", "grasps"), ("estimates", "estimates")):
        if getattr(options, option) and group not in scene.groups:
            note(f"--{option}: nothing in image {options.image[0]}/{options.image[1]}")
    return scene


def _inputs(options: argparse.Namespace) -> tuple[BopDataset, dict[str, Results]]:
    """Return the dataset and the estimates of the options, with the fused poses as one more."""
    from graspcast.estimates.directories import named_directories, open_directories
    from graspcast.estimates.loading import load_inputs

    files = with_built_in(options)
    if options.fused is not None and _FUSED in dict(files.estimates):
        raise InputError(f"an estimator is called {_FUSED}: give its file another name")
    estimates = [*files.estimates, *([(_FUSED, options.fused)] if options.fused else [])]
    if not files.bop:
        raise InputError("models are needed: give their BOP directory", parameters=("bop",))
    if not estimates:
        named = named_directories(files.bop, files.ground_truth)
        datasets = dict(open_directories(named, [], options.sensor))
        results: dict[str, dict[str, Results]] = {}
    else:
        inputs = load_inputs(
            estimates,
            bop=files.bop,
            ground_truth=files.ground_truth,
            objects=options.objects,
            lenient=options.lenient,
            sensor=options.sensor,
        )
        datasets = dict(inputs.datasets)
        results = {of: dict(tables) for of, tables in inputs.results.items()}
        note(*inputs.notes, *inputs.lengths)
    names = list(results or datasets)
    if len(names) > 1:
        raise InputError(
            f"these are of {' and '.join(names)}; view one dataset at a time", parameters=("bop",)
        )
    return datasets[names[0]], results.get(names[0], {})


def _grasps(options: argparse.Namespace, dataset: BopDataset) -> Grasps | None:
    from graspcast.forecasting.grasp_file import read_grasps_of
    from graspcast.forecasting.verdict_file import read_verdicts
    from graspcast.simulation.grasps.table import read_grasps
    from graspcast.simulation.grippers import load_gripper
    from graspcast.viewing.image_scene import Grasps

    if options.verdicts is None:
        return None
    own: dict[str, Gripper] = {}
    if options.gripper is not None:
        gripper = load_gripper(options.gripper)
        own[gripper.name] = gripper
    verdicts = read_verdicts(options.verdicts)
    if verdicts and not any(row.key.dataset == dataset.name for row in verdicts):
        raise InputError(
            f"{options.verdicts}: its verdicts are of {verdicts[0].key.dataset}, not of "
            f"{dataset.name}",
            parameters=("verdicts", "bop"),
        )
    ranked = {} if options.ranked_grasps is None else read_grasps_of(options.ranked_grasps)
    table = read_grasps(options.grasps, protocol=options.protocol)
    return Grasps(verdicts, table, lambda name: own.get(name) or load_gripper(name), ranked)


def _refuse(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Raise if an option is given that is of the other kind of scene."""
    for name in names:
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')} {why}")

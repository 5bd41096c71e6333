"""Estimates of the built-in estimators on the shipped tables, computed once and cached."""

from __future__ import annotations

import logging
from importlib.metadata import version
from importlib.resources import files as files_of
from pathlib import Path

from graspcast._version import __version__
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import read_detections
from graspcast.demo_data import demo_dataset
from graspcast.errors import FormatError, InputError
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.cache import cache_directory
from graspcast.io.hashing import canonical_json, sha256, sha256_of_file
from graspcast.io.progress import Progress, step_of
from graspcast.perception import BUILT_IN, built_in
from graspcast.perception.run import run_estimator

__all__ = ["shipped_estimates"]

_log = logging.getLogger(__name__)
_BOXES = "test_detections_jittered.json"
_MANIFEST = "manifest.json"
_ENGINES = ("onnxruntime", "poselib", "numpy", "pillow")


def shipped_estimates(
    dataset: BopDataset | None = None, *, progress: Progress | None = None
) -> dict[str, Path]:
    """Return the results CSV of each built-in estimator on the shipped tables.

    They are computed in about twenty seconds where they are not in the cache directory, or where a
    file there is not what was written. They depend on images, detections, weights and versions.

    Parameters
    ----------
    dataset
        Other tables of the same objects; the shipped ones if None.
    progress
        Called with the share done and the estimator that runs; not at all if they are cached.

    Returns
    -------
    Estimator's name to its file, which is called ``NAME_DATASET-test.csv``.

    Raises
    ------
    InputError
        If the cache directory cannot be written.
    """
    dataset = demo_dataset() if dataset is None else dataset
    key = _key(dataset)
    folder = cache_directory() / "built-in-estimates" / key[:32]
    files = {name: folder / f"{name}_{dataset.name}-test.csv" for name in BUILT_IN}
    if _are_cached(folder, files):
        return files
    detections = read_detections(dataset.root / _BOXES, dataset)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror}); GRASPCAST_CACHE names another "
            "directory for files that can be computed again"
        ) from error
    for number, (name, path) in enumerate(files.items()):
        step = step_of(progress, number, len(files), f"the estimator {name} looks at the tables")
        run_estimator(built_in(name), dataset, detections, path, progress=step)
    write_artefact(folder / _MANIFEST, {"files": _digests(files), "key": key})
    return files


def _are_cached(folder: Path, files: dict[str, Path]) -> bool:
    """Whether the files are there and as they were written."""
    manifest = folder / _MANIFEST
    if not manifest.exists():
        return False
    try:
        if read_artefact(manifest, "remove it")["files"] == _digests(files):
            return True
        problem = "a file is not what was written"
    except (FormatError, OSError, KeyError) as error:
        problem = str(error)
    _log.warning("%s is damaged (%s) and is computed again", folder, problem)
    return False


def _digests(files: dict[str, Path]) -> dict[str, str]:
    return {name: sha256_of_file(path) for name, path in files.items()}


def _key(dataset: BopDataset) -> str:
    """Return a hash of all that the estimates depend on."""
    weights = Path(str(files_of("graspcast.perception") / "weights"))
    inputs = sorted(
        path
        for path in (*dataset.root.rglob("*"), *weights.iterdir())
        if path.is_file() and path.suffix != ".md"
    )
    versions = {name: version(name) for name in _ENGINES}
    names = [path.name for path in inputs]
    return sha256(
        canonical_json({"graspcast": __version__, "versions": versions, "names": names}),
        *map(sha256_of_file, inputs),
    )

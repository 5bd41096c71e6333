"""Cases: the files of one dataset, read by the readers of every verb; refusals are findings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset, Camera, GroundTruth, read_ground_truth
from graspcast.bop.detections import Detections, read_detections
from graspcast.bop.models import Models
from graspcast.bop.results import Results, read_results
from graspcast.bop.scenes import sensors_in
from graspcast.bop.unit_checks import models_problem
from graspcast.bop.units import metres
from graspcast.diagnosis.contradictions import repeated_in_one
from graspcast.diagnosis.discovery import Found, method_of
from graspcast.diagnosis.finding import Finding
from graspcast.diagnosis.refusals import refusal
from graspcast.errors import FormatError, GraspcastError
from graspcast.estimates.outcomes import read_outcomes
from graspcast.io.json import read_json
from graspcast.views.camera_motion import CameraMotion
from graspcast.views.camera_tables import read_camera_motion

__all__ = ["Case", "Scenes", "cases_of", "read_case"]

T = TypeVar("T")

_OF_ROWS, _LEAST_ROWS = ("poses-behind", "rows-repeated", "results-unreadable", "no-rotation"), 20


@dataclass(eq=False)
class Scenes:
    """A directory of scene folders.

    Attributes
    ----------
    path
        The directory.
    dataset
        The dataset, opened with this directory as its split.
    truth
        Its true poses, None without any, or refused.
    images
        Image files by scene and image.
    motion
        Its camera poses, None without any.
    cameras_known
        Whether the cameras could be read.
    """

    path: Path
    dataset: BopDataset
    truth: GroundTruth | None = None
    images: dict[tuple[int, int], Path] = field(default_factory=dict)
    motion: CameraMotion | None = None
    cameras_known: bool = True

    def camera(self, scene_id: int, im_id: int) -> Camera | None:
        """Return the camera of an image, None if it is not known."""
        if not self.cameras_known:
            return None
        return self._own.get((scene_id, im_id), self._common)

    @cached_property
    def _own(self) -> dict[tuple[int, int], Camera]:
        given = self.dataset.scene_folders.has("camera")
        return self.dataset.scene_cameras if given else {}

    @cached_property
    def _common(self) -> Camera | None:
        there = any(self.dataset.root.glob("camera*.json"))
        return self.dataset.camera if there else None


@dataclass(eq=False)
class Case:
    """The files of one dataset.

    Attributes
    ----------
    name
        The dataset's name.
    root
        Its directory, None where there is none.
    models
        Its object models, None where there are none, or refused.
    other_models
        Further directories of models of the same objects.
    scenes
        Directories of scene folders.
    results
        Estimator's name to its estimates.
    detections
        Tables of detections.
    outcomes
        Outcome tables by path.
    motions
        Camera poses from tables.
    findings
        What the readers refused.
    doubts
        Refusals of single rows, by estimator or file: the other rows may show what is wrong with
        all of them.
    blamed
        Estimators, and ground truth, that were found wrong as a whole.
    """

    name: str
    root: Path | None = None
    models: Models | None = None
    other_models: list[Models] = field(default_factory=list)
    scenes: list[Scenes] = field(default_factory=list)
    results: dict[str, Results] = field(default_factory=dict)
    detections: list[Detections] = field(default_factory=list)
    outcomes: dict[Path, pl.DataFrame] = field(default_factory=dict)
    motions: list[CameraMotion] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    doubts: dict[str, Finding] = field(default_factory=dict)
    blamed: set[str] = field(default_factory=set)

    def attempt(
        self,
        kind: str,
        path: str | PathLike[str],
        read: Callable[..., T],
        *arguments: Any,
        blame: str = "",
    ) -> T | None:
        """Return what is read; a refusal becomes a finding, and None is returned.

        Parameters
        ----------
        kind, path
            What is read from where.
        read, arguments
            The reader, and what it is given.
        blame
            A source that the later checks leave out if it is refused.
        """
        try:
            return read(*arguments)
        except GraspcastError as error:
            self.findings.append(refusal(error, kind, path))
            self.blamed.add(blame)
            return None

    @property
    def truths(self) -> list[Scenes]:
        """The scene directories with true poses."""
        return [s for s in self.scenes if s.truth is not None and len(s.truth)]

    @property
    def sound(self) -> dict[str, Results]:
        """The estimates that no earlier check has found wrong as a whole."""
        return {n: t for n, t in self.results.items() if n not in self.blamed and len(t)}

    def symmetries(self, obj_id: int) -> Float[ndarray, "s 4 4"]:
        """Return an object's stated symmetries, the identity alone for one without a model."""
        known = self.models is not None and obj_id in self.models.info
        return self.models[obj_id].symmetries if known and self.models else np.eye(4)[None]

    def diameter_m(self, obj_id: int) -> float:
        """Return an object's diameter, NaN without a model."""
        known = self.models is not None and obj_id in self.models.info
        return self.models[obj_id].diameter_m if known and self.models else float("nan")


def cases_of(found: Iterable[Found]) -> list[list[Found]]:
    """Group what was found by dataset; what states none goes with the only one, or by itself."""
    found = list(found)
    groups: dict[str, list[Found]] = {}
    stated = {f.dataset.casefold() for f in found if f.kind in ("root", "models", "scenes")} or {
        f.dataset.casefold() for f in found if f.dataset
    }
    only = next(iter(stated)) if len(stated) == 1 else ""
    for entry in found:
        key = entry.dataset.casefold()
        mine = key if key in stated else (only or key)
        groups.setdefault(mine, []).append(entry)
    return list(groups.values())


def read_case(entries: list[Found]) -> Case:
    """Read the files of one dataset."""
    named = [e.dataset for e in entries if e.kind in ("root", "models", "scenes")]
    case = Case((named or [e.dataset for e in entries])[0] or "unnamed")
    of = {
        kind: [e for e in entries if e.kind == kind]
        for kind in (
            "root",
            "models",
            "scenes",
            "results",
            "detections",
            "outcomes",
            "camera-poses",
        )
    }
    roots = [e.path for e in of["root"]]
    beside = [e.path.parent for e in (*of["models"], *of["scenes"])]
    case.root = next(iter([*roots, *beside]), None)
    _read_models(case, [e.path for e in of["models"]])
    for entry in of["scenes"]:
        for sensor in sensors_in(entry.path) or [""]:
            _read_scenes(case, entry.path, sensor)
    for entry in of["results"]:
        _read_results(case, entry)
    for entry in of["detections"]:
        _read_detections(case, entry.path)
    for entry in of["camera-poses"]:
        motion = case.attempt("camera-poses", entry.path, read_camera_motion, entry.path)
        case.motions += [motion] if motion is not None else []
    for entry in of["outcomes"]:
        _read_outcomes(case, entry.path)
    return case


def _read_models(case: Case, paths: list[Path]) -> None:
    """Read the directories of models; the one called ``models_eval`` is compared with first."""
    for path in sorted(paths, key=lambda p: p.name != "models_eval"):
        scaled = case.attempt("models", path, _check_scale, path / "models_info.json")
        models = case.attempt("models", path, Models, path) if scaled is not None else None
        if models is None:
            continue
        sound = True
        for obj_id in models.info:
            if (path / f"obj_{obj_id:06d}.ply").is_file():
                before = len(case.findings)
                mesh = case.attempt("mesh", path, models.mesh, obj_id)
                sound &= mesh is not None
                if len(case.findings) > before + 1:
                    break
        if case.models is None and sound:
            case.models = models
        elif sound:
            case.other_models.append(models)
    case.findings = _merged(case.findings)


def _check_scale(path: Path) -> bool:
    """Raise if the diameters are not in millimetres; all else that is read depends on them."""
    listed = [e.get("diameter") for e in read_json(path, dict).values() if isinstance(e, dict)]
    known = np.array([x for x in listed if isinstance(x, int | float) and x > 0], dtype=float)
    if len(known) and (problem := models_problem(metres(known))):
        raise FormatError(path, problem)
    return True


def _merged(findings: list[Finding]) -> list[Finding]:
    """Keep one finding of each code and directory; the others say the same of other objects."""
    out: dict[tuple[str, str], Finding] = {}
    for finding in findings:
        key = finding.code, str(Path(finding.path).parent)
        out.setdefault(key, finding)
    return list(out.values())


def _read_scenes(case: Case, path: Path, sensor: str) -> None:
    """Read the annotations of one camera of a directory of scene folders."""
    own = case.root or path.parent
    dataset = case.attempt("camera", own, _dataset, own, path, case.name, sensor)
    if dataset is None:
        return
    scenes, folders = Scenes(path, dataset), dataset.scene_folders
    size = case.attempt("camera", own, lambda: (dataset.image_size,))
    scenes.cameras_known = size is not None
    if scenes.cameras_known and any(own.glob("camera*.json")):
        scenes.cameras_known = case.attempt("camera", own, lambda: dataset.camera) is not None
    if folders.has("camera") and scenes.cameras_known:
        read = case.attempt("camera", path, lambda: dataset.scene_cameras)
        scenes.cameras_known = read is not None
    if folders.has("gt"):
        diameters = {i: m.diameter_m for i, m in case.models.info.items()} if case.models else {}
        scenes.truth = case.attempt("truth", path, read_ground_truth, folders, diameters)
    if dataset.has_images:
        scenes.images = case.attempt("images", path, lambda: dataset.images) or {}
    if any("cam_R_w2c" in p.read_text() for p in sorted(path.glob("*/scene_camera.json"))[:3]):
        scenes.motion = case.attempt("camera-poses", path, read_camera_motion, path)
    case.scenes.append(scenes)


def _dataset(root: Path, scenes: Path, name: str, sensor: str) -> BopDataset:
    return BopDataset(root, ground_truth=scenes, name=name, sensor=sensor or None)


def _read_results(case: Case, entry: Found) -> None:
    name = entry.name or method_of(entry.path, list(case.results))
    try:
        case.results[name] = read_results(entry.path)
    except GraspcastError as error:
        found = refusal(error, "results", entry.path)
        if found.code in _OF_ROWS:
            rest = _rest(entry.path)
            if rest is not None:
                case.results[name], case.doubts[name] = rest, found
                return
        case.findings.append(found)


def _rest(path: Path) -> Results | None:
    """Return the rows that can be read, if they are enough to be compared."""
    try:
        rest = read_results(path, lenient=True)
    except GraspcastError:
        return None
    return rest if len(rest) >= _LEAST_ROWS else None


def _read_detections(case: Case, path: Path) -> None:
    sized = next((s.dataset for s in case.scenes if s.images), None)
    dataset = sized if sized is not None and case.models is not None else None
    try:
        case.detections.append(read_detections(path, dataset))
    except GraspcastError as error:
        found = refusal(error, "boxes", path)
        if found.code != "boxes-unreadable":
            case.findings.append(found)
            return
        try:
            rest = read_detections(path, lenient=True)
        except GraspcastError:
            case.findings.append(found)
            return
        case.detections.append(rest)
        case.doubts[str(path)] = found


def _read_outcomes(case: Case, path: Path) -> None:
    try:
        case.outcomes[path] = read_outcomes(path)
    except GraspcastError as error:
        case.findings.append(repeated_in_one(path, error) or refusal(error, "outcomes", path))

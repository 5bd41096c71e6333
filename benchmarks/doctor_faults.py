"""Faults injected into real data: how many ``graspcast doctor`` finds, and names rightly.

Each draw cuts at most 30 images and a few objects out of LM-O, YCB-V or the data that ship, damages
the files at random in one way, and runs the diagnosis. A fault counts as found if a finding has its
code, and as named if that is the first finding of its severity, with none graver before it;
findings that the undamaged files have too are left out. Undamaged files are counted as well.

Thresholds were chosen on half of the objects (``--half 0``); figures are those of the other half.

    python benchmarks/doctor_faults.py --data DATA [--draws 4] [--half 1] [--json FILE]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from doctor_files import ESTIMATORS, OBJECTS, Files, demo, published
from doctor_injections import FAULTS, Fault, direction
from graspcast.bop.results import Results
from graspcast.demo_data import demo_dataset
from graspcast.diagnosis import shapes
from graspcast.diagnosis.case import Case, cases_of, read_case
from graspcast.diagnosis.diagnose import diagnose
from graspcast.diagnosis.discovery import discover
from graspcast.diagnosis.finding import SEVERITIES, Finding
from graspcast.diagnosis.offsets import find_offset
from graspcast.diagnosis.pairs import TRUTH, Pair, pairs_of, sources_of
from graspcast.io.markdown import table
from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.transforms import invert, rotation_angle, rotation_from_vector, transform

BASES = {
    "any": ("lmo", "ycbv"),
    "boxes": ("lmo-boxes", "demo"),
    "demo": ("demo",),
    "ycbv": ("ycbv",),
    "symmetric": ("lmo-symmetric", "ycbv-flipped"),
    "other": ("lmo-other", "ycbv-other"),
}


def base(data: Path, kind: str, rng: np.random.Generator, half: int) -> Files:
    """Return an undamaged dataset."""
    if kind == "demo":
        return demo(rng, half)
    name, _, what = kind.partition("-")
    if what == "symmetric":
        return published(data, name, rng, half, boxes=True, also=(10,))
    files = published(data, name, rng, half, boxes=what == "boxes")
    if what == "boxes":
        files.results = {}
        files.outcomes = {}
    if what == "flipped":
        files.flipped = flipped(files, rng)
    if what == "other":
        other = published(data, "ycbv" if name == "lmo" else "lmo", rng, half)
        files.other = other.results["gdrnpp"]
    return files


def flipped(files: Files, rng: np.random.Generator) -> tuple[str, Results]:
    """Turn half of an estimator's poses of a box by half a turn, as if it had no colours."""
    name = str(rng.choice(ESTIMATORS))
    results = files.results[name]
    numbers = [i for i in (2, 5, 8, 9) if i in files.meshes]
    obj_id = max(numbers, key=lambda i: (results.obj_id == i).sum())
    poses = results.cam_T_obj.copy()
    centre = shapes.surface_of(_models(files, obj_id), obj_id)
    assert centre is not None
    R = rotation_from_vector(np.array([0, 0, np.pi]))
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = R, centre.centroid - R @ centre.centroid
    mine = (results.obj_id == obj_id) & (rng.random(len(results)) < 0.5)
    poses[mine] = poses[mine] @ turn
    return name, replace(results, cam_T_obj=poses)


@cache
def _of_directory(directory: Path):  # type: ignore[no-untyped-def]
    from graspcast.bop.models import Models

    return Models(directory)


def _models(files: Files, obj_id: int):  # type: ignore[no-untyped-def]
    return _of_directory(files.meshes[obj_id].parent)


def run(files: Files) -> list[Finding]:
    with tempfile.TemporaryDirectory() as folder:
        paths, calibration = files.write(Path(folder))
        found = [
            replace(f, message=f.message.replace(f"{folder}/", ""))
            for f in diagnose(paths, calibration=calibration)
        ]
    shapes.surface_of.cache_clear()
    return found


def key(finding: Finding) -> tuple[str, str, str]:
    return finding.severity, finding.code, Path(finding.path).name


def judged(before: list[Finding], after: list[Finding], code: str) -> tuple[bool, bool]:
    """Return whether a code is found, and whether it comes first."""
    known = {key(f) for f in before}
    new = [f for f in after if key(f) not in known]
    return any(f.code == code for f in new), bool(new) and new[0].code == code


def repaired(found: list[Finding], repairs: dict[int, np.ndarray], files: Files) -> list[list]:
    """Return how far the printed transforms are from those injected: object, mm, degrees, exact."""
    out = []
    for finding in found:
        for obj_id, matrix in finding.repair.items():
            apart = invert(repairs[obj_id]) @ matrix
            of = finding.numbers[str(obj_id)]
            mm, deg = float(np.linalg.norm(apart[:3, 3])) * 1000, rotation_angle(apart[:3, :3])
            out.append([obj_id, mm, float(np.degrees(deg)), of["exact"], of["instances"]])
    return out


def quick_symmetries() -> None:
    """Look for the symmetries of the same mesh once: the answer is the same."""
    search, known = shapes.find_symmetries, {}

    def find(surface):  # type: ignore[no-untyped-def]
        digest = hashlib.sha256(surface.triangles.tobytes()).digest()
        if digest not in known:
            known[digest] = search(surface)
        return known[digest]

    shapes.find_symmetries = find


def trial(fault: Fault, draw: int, options: argparse.Namespace) -> dict:
    kinds = BASES[fault.base]
    kind = kinds[draw % len(kinds)]
    seed = [options.seed, draw, FAULTS.index(fault)]
    files = base(options.data, kind, np.random.default_rng(seed), options.half)
    before = run(deepcopy(files))
    start = time.perf_counter()
    repairs = fault.inject(files, np.random.default_rng([*seed, 1]))
    after = run(files)
    found, first = judged(before, after, fault.code)
    return {
        "fault": fault.name,
        "code": fault.code,
        "base": kind,
        "draw": draw,
        "found": found,
        "named": first,
        "seconds": time.perf_counter() - start,
        "example": next(
            ([f.severity, f.sentence, f.cure] for f in after if f.code == fault.code), None
        ),
        "healthy": [f.code for f in before if f.severity != "note"],
        "healthy_notes": sum(f.severity == "note" for f in before),
        "findings": [] if first else [f"{f.severity} {f.code}: {f.message}"[:300] for f in after],
        "repairs": repaired(after, repairs, files) if repairs else [],
    }


def report(trials: Sequence[dict]) -> str:
    rows = []
    for fault in FAULTS:
        mine = [t for t in trials if t["fault"] == fault.name]
        if mine:
            counts = [f"{sum(t[k] for t in mine)}/{len(mine)}" for k in ("found", "named")]
            rows.append([fault.name, f"`{fault.code}`", *counts])
    found, named = (sum(t[k] for t in trials) for k in ("found", "named"))
    rows.append(["**all**", "", f"{found}/{len(trials)}", f"{named}/{len(trials)}"])
    return table(["fault", "code", "found", "named"], rows)


def examples(trials: Sequence[dict]) -> str:
    """Return one finding of each code, with its numbers and cure."""
    found = {t["code"]: t["example"] for t in reversed(trials) if t["example"]}
    return "\n".join(
        f"- **`{code}`** ({severity}): {said} *{cure}.*"
        for code, (severity, said, cure) in sorted(found.items())
    )


def healthy(data: Path) -> list[list[str]]:
    """Count findings on whole directories as they are."""
    sets = {
        "LM-O": [data / "bop" / "lmo", data / "published" / "lmo"],
        "YCB-V": [data / "bop" / "ycbv", data / "published" / "ycbv"],
        "as shipped": [demo_dataset().root],
        "all shared data": [data],
    }
    rows = []
    for name, paths in sets.items():
        start = time.perf_counter()
        found = diagnose(paths)
        by_file: dict[str, int] = {}
        for finding in found:
            by_file[finding.path] = by_file.get(finding.path, 0) + 1
        counts = [str(sum(f.severity == s for f in found)) for s in SEVERITIES]
        most = str(max(by_file.values(), default=0))
        rows.append([name, *counts, most, f"{time.perf_counter() - start:.0f}"])
    return rows


def accuracies(trials: Sequence[dict]) -> list[list[str]]:
    """Return how exact the printed transforms are, by kind of fault: medians and 90 %."""
    rows = []
    for fault in FAULTS:
        mine = [r for t in trials if t["fault"] == fault.name for r in t["repairs"]]
        if mine:
            rows.append([fault.name, *_quantiles(np.array(mine, dtype=float)[:, 1:3])])
    return rows


def _quantiles(errors: np.ndarray) -> list[str]:
    mm, deg = np.quantile(errors, [0.5, 0.9], axis=0).T
    return [str(len(errors)), *(f"{x:.2f}" for x in (*mm, *deg))]


def unbiased(data: Path, half: int, seed: int) -> list[list[str]]:
    """Measure transforms from 30 images and three estimators, as published and without bias.

    Bias is the constant transform between an estimator and ground truth over all images of an
    object; no file of 30 images can tell it from another model frame.
    """
    rows = []
    for name in ("lmo", "ycbv"):
        files = [data / "published" / name, _of_name(data, name)]
        (group,) = cases_of(discover(files)[0])
        case = read_case(group)
        sources, _ = sources_of(case)
        pairs = pairs_of(sources, case.name)
        for remove in (False, True):
            errors = [
                e
                for obj_id in OBJECTS[name][half]
                for draw in range(5)
                for e in _of_object(case, pairs, obj_id, remove, [seed, draw, obj_id])
            ]
            words = "without bias" if remove else "as published"
            rows.append([f"{name}, {words}", *_quantiles(np.array(errors))])
    return rows


def _of_name(data: Path, name: str) -> Path:
    return data / "bop" / name / ("models_eval" if name == "lmo" else "models")


def _of_object(
    case: Case, pairs: Mapping[tuple[str, str], Pair], obj_id: int, remove: bool, seed: list[int]
) -> list[tuple[float, float]]:
    rng = np.random.default_rng(seed)
    D = transform(
        rotation_from_vector(direction(rng) * rng.uniform(0.4, 2.0)),
        direction(rng) * rng.uniform(0.02, 0.1),
    )
    poses, others = [], []
    shared: list[tuple[int, int]] = []
    for estimator in ESTIMATORS:
        pair = pairs[estimator, TRUTH]
        mine = pair.obj_id == obj_id
        est, true = pair.poses[mine], pair.others[mine]
        images = list(map(tuple, pair.images[mine].tolist()))
        if not shared:
            picked = rng.choice(len(images), min(30, len(images)), replace=False)
            shared = [images[i] for i in picked.tolist()]
        if remove:
            size = case.diameter_m(obj_id)
            est = est @ find_offset(est, true, case.symmetries(obj_id), size).one_T_other
        rows = [i for i, image in enumerate(images) if image in shared]
        poses.append(est[rows] @ invert(D))
        others.append(true[rows])
    found = find_offset(
        np.concatenate(poses),
        np.concatenate(others),
        case.symmetries(obj_id),
        case.diameter_m(obj_id),
    )
    apart = nearest_symmetric(
        (invert(D) @ found.one_T_other)[None], invert(case.symmetries(obj_id))
    )[0]
    turn = float(np.degrees(rotation_angle(apart[:3, :3])))
    return [(1000 * float(np.linalg.norm(apart[:3, 3])), turn)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--part", default="0/1", help="this part of the faults alone: 0/2, 1/2")
    parser.add_argument("--half", type=int, choices=(0, 1), default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="a part of the faults' names")
    parser.add_argument("--healthy", action="store_true", help="count findings on whole data too")
    parser.add_argument("--repairs", action="store_true", help="measure transforms without bias")
    parser.add_argument("--examples", action="store_true", help="print a finding of each code")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    quick_symmetries()
    trials = []
    part, parts = map(int, options.part.split("/"))
    for fault in FAULTS[part::parts]:
        if options.only in fault.name:
            for draw in range(options.first, options.first + options.draws):
                trials.append(trial(fault, draw, options))
                if not trials[-1]["named"]:
                    print(
                        trials[-1]["fault"],
                        trials[-1]["base"],
                        draw,
                        trials[-1]["findings"],
                        flush=True,
                    )
    print(report(trials))
    if options.examples:
        print(examples(trials))
    errors = sorted({code for t in trials for code in t["healthy"]})
    wrong, notes = sum(bool(t["healthy"]) for t in trials), [t["healthy_notes"] for t in trials]
    print(
        f"undamaged subsets with errors or warnings: {wrong} of {len(trials)} {errors}; "
        f"most notes {max(notes, default=0)}"
    )
    rows = healthy(options.data) if options.healthy else []
    if rows:
        head = ["data", *(f"{s}s" for s in SEVERITIES), "most of one file", "seconds"]
        print(table(head, rows))
    head = ["", "objects", "mm, median", "mm, 90 %", "degrees, median", "degrees, 90 %"]
    exact = accuracies(trials)
    if exact:
        print(table(head, exact))
    bias = unbiased(options.data, options.half, options.seed) if options.repairs else []
    if bias:
        print(table(head, bias))
    if options.json:
        options.json.write_text(
            json.dumps({"trials": trials, "healthy": rows, "bias": bias}, indent=1)
        )


if __name__ == "__main__":
    main()

"""The verb ``doctor``: what is wrong with files, before anything is run."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graspcast.cli.console import note, print_text
from graspcast.cli.options import Verbs, add_json, maybe_named, new_verb, write_json
from graspcast.cli.progress import progress_bar
from graspcast.io.wording import counted

if TYPE_CHECKING:
    from graspcast.diagnosis.finding import Finding

__all__ = ["add"]

_COMMANDS = {
    "other-model-frame": (
        "graspcast doctor … --repairs FILE, then graspcast convert … --apply FILE"
    ),
}


def add(verbs: Verbs) -> None:
    """Add the verb ``doctor``."""
    verb = new_verb(
        verbs,
        "doctor",
        _doctor,
        "say what is wrong with files",
        "Look for what is wrong with datasets, models, estimates, detections, outcomes and camera\n"
        "poses, before anything is run: units, cameras, boxes, model frames, symmetries, copies,\n"
        "ids, scenes in two roles. What the files are is found out; directories are searched.\n"
        "Without paths the environment alone is looked at.\n\n"
        "The exit code is 1 if there are errors, else 0.",
    )
    verb.add_argument(
        "paths",
        metavar="PATH",
        type=maybe_named,
        nargs="*",
        help="a file or directory; NAME=FILE names an estimator",
    )
    verb.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="outcomes for calibration: their scenes should not be in the other outcome tables; "
        "may be repeated",
    )
    verb.add_argument(
        "--repairs",
        metavar="FILE",
        type=Path,
        help="write the transforms that mend poses in another model frame (JSON, object's number "
        "to a 4x4 matrix in metres), for convert --apply; with several estimators one file "
        "each, FILE-NAME",
    )
    add_json(verb)
    verb.set_defaults(outputs=("repairs",))


def _doctor(options: argparse.Namespace) -> int:
    from graspcast.diagnosis.diagnose import diagnose

    with progress_bar("checking"):
        findings = diagnose(
            options.paths, calibration=options.calibration, environment=not options.paths
        )
    for finding in findings:
        print_text(_shown(finding))
    counts = {s: sum(f.severity == s for f in findings) for s in ("error", "warning", "note")}
    print_text(", ".join(counted(n, s) for s, n in counts.items()))
    write_json(
        options.json, {"counts": counts, "findings": [finding.as_dict() for finding in findings]}
    )
    if options.repairs is not None:
        _write_repairs(options.repairs, findings)
    return 1 if counts["error"] else 0


def _shown(finding: Finding) -> str:
    """Return a finding as a few lines of text, a repairing transform below it."""
    lines = [
        f"{finding.severity}: {finding.code}: {finding.path}",
        f"  {finding.sentence}",
        f"  → {finding.cure}",
    ]
    if finding.code in _COMMANDS:
        lines.append(f"    {_COMMANDS[finding.code]}")
    for obj_id, matrix in finding.repair.items():
        lines.append(f"    object {obj_id} (metres):")
        lines += ["      " + " ".join(f"{x:10.6f}" for x in row) for row in matrix.tolist()]
    return "\n".join(lines)


def _write_repairs(path: Path, findings: Sequence[Finding]) -> None:
    """Write the repairs of each estimator."""
    from graspcast.io import json

    found = [finding for finding in findings if finding.repair]
    if not found:
        note(f"{path}: not written, since there is nothing to repair")
    for finding in found:
        name = f"{path.stem}-{finding.estimator or 'all'}{path.suffix}"
        out = path if len(found) == 1 else path.with_name(name)
        repairs = {str(i): matrix.tolist() for i, matrix in finding.repair.items()}
        json.write_json(out, {"unit": "m", **repairs})
        print_text(str(out))

"""Measure how much of graspcast its tests run: lines and branches, also in processes they start.

python scripts/measure_coverage.py [--fast] [--fail-under 95] [TESTS ...]

Prints what is not run, the files with most of it first. Without --fast the slow tests run, too.
What Numba compiles is left out (Python does not run those lines), by pyproject.toml.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tests", nargs="*", help="default: all")
    parser.add_argument("--fast", action="store_true", help="without the slow tests")
    parser.add_argument("--fail-under", type=float, default=0.0, metavar="PERCENT")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        report = Path(scratch) / "coverage.json"
        command = [sys.executable, "-m", "pytest", "-q", "--cov", f"--cov-report=json:{report}"]
        command += [*([] if options.fast else ["--slow"]), *options.tests]
        environment = {**os.environ, "COVERAGE_FILE": str(Path(scratch) / "data")}
        failed = subprocess.run(command, cwd=ROOT, env=environment).returncode
        if not report.exists():
            return failed or 1
        measured = json.loads(report.read_text(encoding="utf-8"))
    share = measured["totals"]["percent_covered"]
    print_missing(measured["files"])
    print(f"\n{share:.2f} % of lines and branches are run")
    return failed or int(share < options.fail_under)


def print_missing(files: dict[str, dict]) -> None:
    """Print lines and branches that are not run, file by file."""

    def missing(name: str) -> int:
        found = files[name]["summary"]
        return found["missing_lines"] + found["missing_branches"]

    for name in sorted((name for name in files if missing(name)), key=lambda n: (-missing(n), n)):
        lines = ", ".join(ranges(files[name]["missing_lines"]))
        # Branches from a line that is run to one that is never reached from there; -1 is the end.
        seen = set(files[name]["executed_lines"])
        jumps = [(a, b) for a, b in files[name]["missing_branches"] if a in seen]
        arcs = ", ".join(f"{a} to {'the end' if b < 0 else b}" for a, b in jumps)
        percent = files[name]["summary"]["percent_covered"]
        print(f"{percent:6.1f} % {name}: " + "; ".join(filter(None, (lines, arcs))))


def ranges(lines: list[int]) -> list[str]:
    """Return numbers as ranges: 3, 5-8."""
    out: list[list[int]] = []
    for line in lines:
        if out and line == out[-1][1] + 1:
            out[-1][1] = line
        else:
            out.append([line, line])
    return [str(a) if a == b else f"{a}-{b}" for a, b in out]


if __name__ == "__main__":
    sys.exit(main())

"""Measure how much of graspcast its tests run: lines and branches, also in processes they start.

python scripts/measure_coverage.py [--fast] [--fail-under 95] [--training PYTHON] [TESTS ...]

Prints what is not run, the files with most of it first, and the share by package. Without --fast
the slow tests run, too. What Numba compiles is left out (Python does not run those lines), by
pyproject.toml. ``training`` counts where PyTorch is installed (the extra ``train``); with
--training, its tests are run by the Python of another environment that has it, and the two
measurements are put together:

    python -m venv .venv-train && .venv-train/bin/pip install -e '.[test,train]'
    python scripts/measure_coverage.py --training .venv-train/bin/python

--fail-under holds where the published data is, since many tests skip without it. What is not run,
and why, is in docs/architecture.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
TRAINING = "tests/training"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tests", nargs="*", help="default: all")
    parser.add_argument("--fast", action="store_true", help="without the slow tests")
    parser.add_argument("--fail-under", type=float, default=0.0, metavar="PERCENT")
    parser.add_argument(
        "--training", metavar="PYTHON", help="a Python with the extra train, for its tests"
    )
    options = parser.parse_args()
    slow = [] if options.fast else ["--slow"]
    with tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch) / "data"
        failed = run_tests(sys.executable, [*slow, *options.tests], data)
        found = [data]
        if options.training:
            found.append(Path(scratch) / "training")
            failed = run_tests(options.training, [*slow, TRAINING], found[1]) or failed
        found = [path for path in found if path.exists()]
        if not found:
            return failed or 1
        with_training = bool(options.training) or find_spec("torch") is not None
        measured = combined(found, [] if with_training else ["*/graspcast/training/*"])
    print_missing(measured["files"])
    print_packages(measured["files"])
    share = measured["totals"]["percent_covered"]
    print(f"\n{share:.2f} % of lines and branches are run", end="")
    print("" if with_training else "; training/ is left out, as PyTorch is not installed")
    if share >= options.fail_under:
        return failed
    print(f"that is less than {options.fail_under:g} %", end="")
    print("" if has_data() else ", but without the published data it may be")
    return failed or int(has_data())


def has_data() -> bool:
    """Return whether the published data is where tests look for it (tests/conftest.py)."""
    folder = Path(os.environ.get("GRASPCAST_DATA") or ROOT.parent / "shared" / "data")
    return (folder / "published").is_dir()


def run_tests(python: str, arguments: list[str], data: Path) -> int:
    """Run tests and write what they ran to a file; return the exit code."""
    command = [python, "-m", "pytest", "-q", "--cov", "--cov-report=", *arguments]
    environment = {**os.environ, "COVERAGE_FILE": str(data)}
    return subprocess.run(command, cwd=ROOT, env=environment).returncode


def combined(found: list[Path], omitted: list[str]) -> dict:
    """Return the report on several measurements together."""
    whole, report = found[0].with_name("whole"), found[0].with_name("report.json")
    environment = {**os.environ, "COVERAGE_FILE": str(whole)}
    coverage = (sys.executable, "-m", "coverage")
    omit = [f"--omit={','.join(omitted)}"] if omitted else []
    # Copies of the package that a test made are gone: their sources are not looked for.
    for command in (
        ("combine", "--quiet", *map(str, found)),
        ("json", "--quiet", "--ignore-errors", "-o", str(report), *omit),
    ):
        subprocess.run([*coverage, *command], cwd=ROOT, env=environment, check=True)
    return json.loads(report.read_text(encoding="utf-8"))


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


def print_packages(files: dict[str, dict]) -> None:
    """Print the share of each package, the lowest first."""
    counts: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for name, file in files.items():
        parts = Path(name).parts
        found, package = file["summary"], counts[parts[parts.index("graspcast") + 1]]
        package[0] += found["covered_lines"] + found["covered_branches"]
        package[1] += found["num_statements"] + found["num_branches"]
    print()
    for name, (run, all_) in sorted(counts.items(), key=lambda c: c[1][0] / max(c[1][1], 1)):
        if all_:
            print(f"{100 * run / all_:6.1f} % {name}: {all_ - run} of {all_} not run")


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

"""Install a wheel into a fresh environment outside the checkout, and use it as a stranger would.

python scripts/try_wheel.py dist [--demo]

It says how long installing, importing and ``--help`` take, and how large the environment is, and
then runs ``.ci/smoke.py``. With --demo, it also runs the demonstration, and after it the first
Python of the README.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

from environments import python_of

ROOT = Path(__file__).parents[1]
IMPORT_S, HELP_S, SIZE_MB = 0.05, 0.2, 1000
PATIENCE = 3  # a busy machine may be so many times slower than the limits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dist", type=Path, help="directory with one wheel")
    parser.add_argument("--demo", action="store_true", help="also run the demonstration")
    parser.add_argument("--constraint", type=Path, help="versions of dependencies, as pip's")
    options = parser.parse_args()
    (wheel,) = options.dist.resolve().glob("*.whl")
    constraint = [f"--constraint={options.constraint.resolve()}"] if options.constraint else []
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch).resolve()
        began = time.perf_counter()
        venv.create(root / "venv", with_pip=True)
        python, empty = python_of(root / "venv"), _size_mb(root / "venv")
        _run(root, python, "-m", "pip", "install", "-qqq", *constraint, str(wheel))
        took, size = time.perf_counter() - began, _size_mb(root / "venv") - empty
        bytecode = _size_mb(root / "venv", "*.pyc")
        print(
            f"installed in {took:.0f} s, {size:.0f} MB, {bytecode:.0f} MB of it bytecode",
            flush=True,
        )
        if size > SIZE_MB:
            sys.exit(f"more than {SIZE_MB} MB are installed")
        _run(root, python, "-m", "pip", "check")
        _quick(root, python, "import graspcast", ["-c", "import graspcast"], IMPORT_S)
        _quick(root, python, "graspcast --help", ["-m", "graspcast", "--help"], HELP_S)
        _run(root, python, str(ROOT / ".ci" / "smoke.py"))
        if options.demo:
            _run(root, python, "-m", "graspcast", "demo")
            (root / "first.py").write_text(_first_python(), encoding="utf-8")
            _run(root, python, "first.py")


def _size_mb(folder: Path, names: str = "*") -> float:
    """Return how large the files of a folder are."""
    return sum(path.stat().st_size for path in folder.rglob(names) if path.is_file()) / 1e6


def _run(folder: Path, *command: str | Path) -> None:
    """Run a command in a folder, without the checkout on Python's path."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    if subprocess.run([str(c) for c in command], cwd=folder, env=environment).returncode:
        sys.exit(f"failed: {' '.join(str(c) for c in command)}")


def _quick(folder: Path, python: Path, what: str, arguments: list[str], limit_s: float) -> None:
    """Time a command over that of starting Python, the best of several; refuse one that is slow."""

    def best(of: list[str]) -> float:
        times = []
        for _ in range(5):
            began = time.perf_counter()
            subprocess.run([str(python), *of], cwd=folder, stdout=subprocess.DEVNULL, check=True)
            times.append(time.perf_counter() - began)
        return min(times)

    seconds = best(arguments) - best(["-c", ""])
    print(f"{what}: {1000 * seconds:.0f} ms (limit {1000 * limit_s:.0f} ms)", flush=True)
    if seconds > PATIENCE * limit_s:
        sys.exit(f"{what} takes {seconds:.2f} s")


def _first_python() -> str:
    """Return the first block of Python in the README."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1]


if __name__ == "__main__":
    main()

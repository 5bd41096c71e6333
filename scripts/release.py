"""Run every check, build a release into dist/, and say what is left to do. Nothing is uploaded.

python scripts/release.py [--out dist] [--skip-tests] [--without STEP ...]

Steps, in their order: ``state`` (nothing uncommitted, and a changelog of this version), ``lint``,
``tests`` (all, and whether they run 95 % of lines and branches), ``lowest`` and ``newest`` (fast
tests with the oldest and newest dependencies),
``build`` (sdist and wheel, and what they hold), ``wheel`` (used in a fresh environment, with the
demonstration), ``uvx`` (the demonstration by ``uvx``, straight from the wheel), ``sbom`` (a
CycloneDX list of the wheel and all that it depends on) and ``checksums``.

--skip-tests leaves out ``tests``, ``lowest`` and ``newest``. If anything is left out, the result is
called no release.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from environments import program, python_of

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "scripts"
TESTS = ("tests", "lowest", "newest")
LEAST = ("--fail-under", "95")


def main() -> None:
    out = ROOT / "dist"
    steps: dict[str, Callable[[Path], None]] = {
        "state": lambda out: check_state(),
        "lint": lambda out: _run(sys.executable, SCRIPTS / "lint.py"),
        "tests": lambda out: _run(sys.executable, SCRIPTS / "measure_coverage.py", *LEAST),
        "lowest": lambda out: _bounds("lowest"),
        "newest": lambda out: _bounds("newest"),
        "build": lambda out: _run(sys.executable, SCRIPTS / "build.py", "--out", out),
        "wheel": lambda out: _run(sys.executable, SCRIPTS / "try_wheel.py", out, "--demo"),
        "uvx": demo_by_uvx,
        "sbom": write_sbom,
        "checksums": write_checksums,
    }
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=out, help="default: dist")
    parser.add_argument("--without", nargs="+", choices=steps, default=[], metavar="STEP")
    parser.add_argument("--skip-tests", action="store_true", help=f"without {', '.join(TESTS)}")
    options = parser.parse_args()
    without = {*options.without, *(TESTS if options.skip_tests else ())}
    if "build" not in without and options.out.is_dir() and any(options.out.iterdir()):
        sys.exit(f"{options.out}: is not empty; delete it, or choose another directory")
    left_out = ", ".join(name for name in steps if name in without)
    if left_out:
        print(f"NOT A RELEASE: left out are {left_out}", flush=True)
    for name, step in steps.items():
        if name not in without:
            print(f"\n== {name}", flush=True)
            began = time.perf_counter()
            step(options.out.resolve())
            print(f"== {name}: {time.perf_counter() - began:.0f} s", flush=True)
    if left_out:
        print(f"\nNOT A RELEASE: {left_out} did not run. Do not upload what is in {options.out}.")
        return
    print(f"\n{options.out} holds graspcast {version()}. Left to do, if it is to be released:")
    print(f"  git tag -a v{version()} -m 'graspcast {version()}' && git push origin v{version()}")
    print(f"  python -m twine upload {options.out}/*.whl {options.out}/*.tar.gz")


def version() -> str:
    """Return the version, which is written in one place."""
    text = (ROOT / "src" / "graspcast" / "_version.py").read_text(encoding="utf-8")
    return re.findall(r'__version__ = "(.+)"', text)[0]


def check_state() -> None:
    """Refuse what is not committed, and a version that is released or not in the changelog."""
    changed = _output("git", "status", "--porcelain")
    if changed:
        sys.exit(f"not committed:\n{changed}")
    tagged = _output(
        "git", "tag", "--list", f"v{version()}", "--format=%(*objectname)%(objectname)"
    )
    if tagged and not tagged.startswith(_output("git", "rev-parse", "HEAD")):
        sys.exit(
            f"v{version()} is the tag of another commit; raise the version in "
            "src/graspcast/_version.py"
        )
    if f"## [{version()}]" not in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"):
        sys.exit(f"CHANGELOG.md has no section [{version()}]")
    if f"\nversion: {version()}\n" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        sys.exit(f"CITATION.cff is not of version {version()}")


def demo_by_uvx(out: Path) -> None:
    """Run the demonstration as ``uvx graspcast demo`` would, from the wheel."""
    (wheel,) = out.glob("*.whl")
    with tempfile.TemporaryDirectory() as scratch:
        uvx = (program("uv"), "tool", "run", "--from", wheel)
        _run(*uvx, "graspcast", "demo", folder=Path(scratch))


def write_sbom(out: Path) -> None:
    """Write what the wheel brings with it, as CycloneDX JSON."""
    bill = out / f"graspcast-{version()}.cdx.json"
    uv = program("uv")
    with tempfile.TemporaryDirectory() as scratch:
        home = Path(scratch) / "venv"
        _run(uv, "venv", "--quiet", f"--python={sys.executable}", home)
        python = python_of(home)
        # By name and version, so that the list does not state a path of this machine.
        install = (uv, "pip", "install", "--quiet", f"--python={python}", "--find-links", out)
        _run(*install, f"graspcast=={version()}")
        make = (sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible")
        _run(*make, "--validate", "--output-format", "JSON", "--output-file", bill, python)
    content = json.loads(bill.read_text(encoding="utf-8"))
    # What the list is about stands apart from what it brings.
    (about,) = (c for c in content["components"] if c["name"] == "graspcast")
    content["components"].remove(about)
    content["metadata"]["component"] = about
    bill.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    print(f"{bill.name}: {len(content['components'])} components")


def write_checksums(out: Path) -> None:
    """Write the SHA-256 of each file, as ``sha256sum -c`` reads it."""
    files = sorted(p for p in out.iterdir() if p.name.startswith("graspcast-"))
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (out / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")
    print("".join(lines), end="")


def _bounds(versions: str) -> None:
    _run(sys.executable, SCRIPTS / "dependency_bounds.py", versions, "--all")


def _output(*command: str) -> str:
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def _run(*command: str | Path, folder: Path = ROOT) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    words = [str(word) for word in command]
    if subprocess.run(words, cwd=folder, env=environment).returncode:
        sys.exit(f"failed: {' '.join(words)}")


if __name__ == "__main__":
    main()

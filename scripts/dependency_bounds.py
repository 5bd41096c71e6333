"""Run fast tests with the lowest or the newest versions that the dependencies may have.

python scripts/dependency_bounds.py lowest|newest [--all] [TESTS ...]

Installs graspcast with uv into a fresh environment, with the lowest versions that pyproject.toml
declares (of what graspcast itself needs; uv's lowest-direct) or the newest, and runs the tests that
touch what each dependency does. With --all, every fast test. PyTorch (extra train) is left out: its
wheels are large, and only training needs it.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

from environments import program, python_of

ROOT = Path(__file__).parents[1]
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
# Small, and between them on each dependency: tables, meshes, networks, trials, pictures.
TESTS = (
    "bop/test_meshes.py",
    "bop/test_results_csv.py",
    "cli/test_predict.py",
    "estimates/test_outcomes.py",
    "forecasting/models/mlp/test_train.py",
    "forecasting/test_verdict_file.py",
    "io",
    "perception/test_network.py",
    "perception/test_pnp.py",
    "pose/test_metrics.py",
    "rendering/trials/test_renderer.py",
    "simulation/campaign/test_campaign.py",
    "simulation/campaign/test_store.py",
    "simulation/grippers/test_franka.py",
    "simulation/objects/test_decomposition.py",
    "simulation/test_engine.py",
    "simulation/test_mujoco_version.py",
    "simulation/trial/test_gripper_conformance.py",
    "simulation/trial/test_trial.py",
    "test_public.py",
)
# What those need: fewer packages than all tests do, so that they are soon installed.
EXTRAS = "plot,render,ycb"
RUNNERS = ("beartype", "hypothesis", "pytest", "pytest-timeout", "pytest-xdist")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("versions", choices=RESOLUTIONS)
    parser.add_argument("tests", nargs="*", help="tests to run in place of the selection")
    parser.add_argument("--all", action="store_true", help="run every fast test")
    parser.add_argument("--python", default=sys.executable, help="default: this one")
    options = parser.parse_args()
    uv = program("uv")
    tests = options.tests or [str(ROOT / "tests" / name) for name in TESTS]
    with tempfile.TemporaryDirectory() as scratch:
        began = time.perf_counter()
        home = Path(scratch) / "venv"
        subprocess.run([uv, "venv", "--quiet", f"--python={options.python}", str(home)], check=True)
        python = python_of(home)
        install = [uv, "pip", "install", "--quiet", f"--python={python}"]
        resolution = f"--resolution={RESOLUTIONS[options.versions]}"
        whole = options.all or options.tests
        wanted = [f"{ROOT}[ray,test]"] if whole else [f"{ROOT}[{EXTRAS}]", *_runners()]
        subprocess.run([*install, resolution, "-e", *wanted], check=True)
        print(f"installed in {time.perf_counter() - began:.0f} s", flush=True)
        subprocess.run([uv, "pip", "freeze", f"--python={python}"], check=True)
        arguments = ["-q", *([] if options.all else tests)]
        # A cache of its own: compiled code is of one version of numba.
        environment = {
            **os.environ,
            "GRASPCAST_CACHE": str(Path(scratch) / "cache"),
            "NUMBA_CACHE_DIR": str(Path(scratch) / "numba"),
        }
        done = subprocess.run([str(python), "-m", "pytest", *arguments], cwd=ROOT, env=environment)
        print(f"{options.versions} versions: {time.perf_counter() - began:.0f} s in all")
    return done.returncode


def _runners() -> list[str]:
    """Return the requirements of the extra ``test`` that run tests."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = project["optional-dependencies"]["test"]
    return [text for text in named if text.partition(">")[0] in RUNNERS]


if __name__ == "__main__":
    sys.exit(main())

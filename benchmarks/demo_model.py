"""Train the demonstration's model, which ships in the package, and say how well it forecasts.

    python benchmarks/demo_model.py --files demo-files --out src/graspcast/demo_data/model.npz

The files of ``graspcast demo`` are used if they are there, and made otherwise (two minutes): poses
by the built-in estimators, and trials of the grasps that ``dense`` guides. It is trained on tables
1 to 20 with fewer trees than the default, so that the file is small, and scored on tables 21 to 30.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from graspcast.cli import main as graspcast
from graspcast.demo_data import demo_dataset

NAMES = ("dense", "direct", "keypoints")


def run(*command: str | Path) -> None:
    if code := graspcast([str(part) for part in command]):
        raise SystemExit(code)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=Path, default=Path("demo-files"))
    parser.add_argument("--trees", type=int, default=32)
    parser.add_argument("--out", type=Path, default=Path("model.npz"))
    options = parser.parse_args()
    root = demo_dataset().root
    bop = ("--bop", root)
    poses = {name: options.files / f"{name}_ycbv-test.csv" for name in NAMES}
    for name, path in poses.items():
        if not path.exists():
            boxes = root / "test_detections_jittered.json"
            run("estimate", *bop, "--detections", boxes, "--estimator", name, "--out", path)
    every = [part for name, path in poses.items() for part in ("--estimates", f"{name}={path}")]
    trials = options.files / "trials"
    if not trials.exists():
        run("simulate", *bop, *every[:2], "--gripper", "parallel", "--out", trials)
    moved = ("--camera-poses", root / "test", "--views-from", "all")
    run(
        *("train", *bop, *every, *moved, "--scenes", "1-20", "--principal", "dense"),
        *("--gripper", "parallel", "--outcomes", trials, "--folds", "0"),
        *("--trees", str(options.trees), "--out", options.out),
    )
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")
    verdicts = options.files / "unseen.csv"
    given = (*bop, *every, "--scenes", "21-30", "--model", options.out, "--threshold", "0.5")
    run("predict", *given, "--out", verdicts)
    run("score", "--verdicts", verdicts, "--outcomes", trials)


if __name__ == "__main__":
    main()

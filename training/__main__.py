"""Train the built-in estimators: render samples, train, export to ONNX."""

from __future__ import annotations

import argparse
from pathlib import Path

SEED = 1


def main() -> None:
    top = argparse.ArgumentParser(prog="python -m training", description=__doc__)
    top.add_argument("--models", type=Path, required=True, help="a BOP directory of models")
    top.add_argument(
        "--work", type=Path, required=True, help="directory of samples and checkpoints"
    )
    verbs = top.add_subparsers(dest="verb", required=True)
    verb = verbs.add_parser("render", help="render training samples")
    verb.add_argument("--files", type=int, default=40, help="of about 1800 samples each")
    verb = verbs.add_parser("train", help="train, or resume training")
    verb.add_argument("--only", nargs="+", default=["dense", "direct", "keypoints"])
    verb.add_argument("--steps", type=int, default=60_000)
    verb.add_argument("--threads", type=int, default=1)
    verb.add_argument(
        "--strength",
        type=float,
        default=0.3,
        help="of augmentation; 1 for photos",
    )
    verb = verbs.add_parser("export", help="write ONNX files from the latest checkpoints")
    verb.add_argument("--only", nargs="+", default=["dense", "direct", "keypoints"])
    verb.add_argument("--out", type=Path, required=True, help="directory of the ONNX files")
    options = top.parse_args()
    from training.crops import Objects

    objects = Objects.read(options.models)
    if options.verb == "render":
        from training.crops import render

        render(options.work / "train", objects, seed=SEED, files=options.files)
    elif options.verb == "train":
        from training.train import train

        train(
            options.work,
            objects,
            options.only,
            steps=options.steps,
            threads=options.threads,
            strength=options.strength,
        )
    elif options.verb == "export":
        from training.export import export

        for name in options.only:
            export(options.work, objects, name, options.out / f"{name}.onnx")


if __name__ == "__main__":
    main()

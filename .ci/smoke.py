"""Does an installed wheel work, with nothing but itself? Run from outside the checkout."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import graspcast

here = Path(graspcast.__file__)
assert "site-packages" in here.parts, here
for name in graspcast.__all__:
    getattr(graspcast, name)
assert (here.parent / "py.typed").is_file()

HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"
rng = np.random.default_rng(0)
with tempfile.TemporaryDirectory() as folder:
    root = Path(folder)
    outcomes = ["estimator,dataset,scene_id,im_id,obj_id,gripper,success"]
    for name in ("one", "two"):
        rows = []
        for image in range(40):
            x = 5.0 * image % 7 + (image % 2) * rng.normal() * 20 * (name == "two")
            rows.append(f"{image % 8},{image},1,0.9,1 0 0 0 1 0 0 0 1,{x} 0 900,-1")
            if name == "one":
                outcomes.append(f"one,toy,{image % 8},{image},1,parallel,{1 - image % 2}")
        (root / f"{name}_toy-test.csv").write_text(HEADER + "\n".join(rows) + "\n")
    (root / "outcomes.csv").write_text("\n".join(outcomes) + "\n")
    estimates = [f"--estimates={n}={root / f'{n}_toy-test.csv'}" for n in ("one", "two")]
    program = [str(Path(sys.executable).with_name("graspcast"))]
    model, verdicts, card = (str(root / n) for n in ("m.npz", "v.csv", "card.json"))
    train = [
        "train",
        *estimates,
        "--principal=one",
        "--gripper=parallel",
        "--features=paper",
        "--method=MLP-O",
    ]
    train += [f"--outcomes={root / 'outcomes.csv'}", f"--out={model}", f"--json={card}"]
    subprocess.run([*program, *train, "--epochs=200", "--folds=2"], check=True)
    subprocess.run(
        [*program, "predict", *estimates, f"--model={model}", f"--out={verdicts}"], check=True
    )
    assert len(Path(verdicts).read_text().splitlines()) == 41
    subprocess.run([*program, "check-gripper", "underactuated"], check=True, capture_output=True)
    assert len(graspcast.read_grasps()) == 29
    assert json.loads(Path(card).read_text())["card"]["principal"] == "one"
print(f"graspcast {graspcast.__version__} works from {here.parent}")

"""An estimator as others write them: standard library only, run by another Python.

Usage: foreign_estimator.py BOP DETECTIONS OUT [HOW] [NOTE]. The pose is upright, where the box is,
as far away as the object's diameter fills it. HOW it misbehaves is the caller's choice; NOTE is a
file to which it writes which processes are running and by which Python.
"""

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

bop, detections, out = map(Path, sys.argv[1:4])
how = sys.argv[4] if len(sys.argv) > 4 else "well"
camera = json.loads((bop / "camera.json").read_text())
models = json.loads((bop / "models" / "models_info.json").read_text())

if how in ("hang", "deaf", "leave"):
    deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); " if how == "deaf" else ""
    child = subprocess.Popen([sys.executable, "-c", deaf + "import time; time.sleep(600)"])
    if how == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    out.write_text("scene_id,im_id,obj_id,score,R,t,time\n")
    note = Path(sys.argv[5])
    aside = note.with_suffix(".part")
    aside.write_text(json.dumps({"child": child.pid, "out": str(out)}))
    aside.rename(note)
    sys.stderr.write("estimating image 1 of 2\n")
    sys.stderr.flush()
    if how != "leave":
        time.sleep(600)

rows = []
for number, d in enumerate(json.loads(detections.read_text())):
    x, y, width, height = d["bbox"]
    z = models[str(d["category_id"])]["diameter"] * camera["fx"] / max(width, height)
    t = [(x + width / 2 - camera["cx"]) * z / camera["fx"]]
    t += [(y + height / 2 - camera["cy"]) * z / camera["fy"], z]
    if how == "metres":
        t = [value / 1000 for value in t]
    image = number if how == "count" else d["image_id"]
    obj_id = 2 if how == "object" else d["category_id"]
    keys = [d["scene_id"], image, obj_id, d["score"]]
    if how == "headers":
        continue
    if how == "nothing" and number == 0:
        t = [0, 0, 0]
    rows.append([*keys, "1 0 0 0 1 0 0 0 1", " ".join(map(repr, t)), -1])

with out.open("w", newline="") as file:
    writer = csv.writer(file)
    writer.writerow(["scene_id", "im_id", "obj_id", "score", "R", "t", "time"])
    writer.writerows(rows)

if how == "half":
    content = out.read_bytes()
    out.write_bytes(content[: len(content) - 30])
elif how == "fail":
    sys.stderr.write("CUDA error: no device\n")
    sys.exit(3)
elif how == "raise":
    raise RuntimeError("weights.pth is missing")
elif how == "silent":
    out.unlink()
elif how == "environment":
    Path(sys.argv[5]).write_text(json.dumps({"prefix": sys.prefix, "argv": sys.argv[1:4]}))

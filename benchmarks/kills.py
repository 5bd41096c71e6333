"""Kills (SIGKILL) of campaigns and of every verb that writes: what is lost, damaged or left behind.

    python benchmarks/kills.py --campaigns 500 --each 100 --json kills.json

Linux only. Inputs are the demonstration data of the package, with estimates and outcomes drawn from
a seed. A campaign is killed (its parent, its whole process group, or one worker), looked at, and
started again, until it is complete; then its outcomes are compared with those of a campaign that
nobody killed. A verb's output, after a kill, must be what was there before or whole; every fifth
time the verb is then run to its end, and must sweep.

    lost       outcomes that were stored are gone, or a complete output is missing some
    doubled    trials that are stored twice, or that were run again though they were stored
    damaged    a file that is neither what was there before nor whole, or a run that then fails
    hung       a process that does not end within two minutes
    left       processes that outlive their parent by 15 s; temporary files after the next run
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.bop.results import Results, read_results, write_results
from graspcast.demo_data import demo_dataset
from graspcast.errors import GraspcastError
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.io.tables import write_table
from graspcast.pose.transforms import exp
from graspcast.simulation.campaign.store import Store

PROBLEMS = ("lost", "doubled", "damaged", "hung", "left")
LONGEST_S, LEAVING_S = 120.0, 15.0
TARGETS = ("parent", "group", "worker")
DATA = demo_dataset()
GRIPPER = "parallel"


class Run:
    """A run of ``graspcast`` in a session of its own; its descendants carry a token."""

    def __init__(self, arguments: list[str], folder: Path):
        self.token = f"GRASPCAST_KILLS={uuid.uuid4().hex}"
        name, _, value = self.token.partition("=")
        temporary = folder / "tmp"
        temporary.mkdir(exist_ok=True)
        self.started = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "graspcast", *arguments],
            env={**os.environ, name: value, "TMPDIR": str(temporary)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=(folder / "stderr").open("wb"),
            start_new_session=True,
        )
        self.said = folder / "stderr"

    def family(self) -> dict[int, str]:
        """Command lines of all living processes that the run started, and its own, by pid."""
        found = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdecimal():
                try:
                    if self.token.encode() in (entry / "environ").read_bytes():
                        line = (entry / "cmdline").read_bytes()
                        found[int(entry.name)] = line.replace(b"\0", b" ").decode(errors="replace")
                except OSError:
                    continue
        return found

    def workers(self) -> list[int]:
        """Return the campaign's worker processes, as soon as they exist."""
        try:
            text = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text()
            return [
                int(pid)
                for pid in text.split()
                if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
            ]
        except OSError:
            return []

    def kill(self, target: str) -> None:
        with suppress(ProcessLookupError):
            if target == "group":
                os.killpg(self.process.pid, signal.SIGKILL)
            elif target == "parent":
                self.process.kill()
            elif workers := self.workers():
                os.kill(random.choice(workers), signal.SIGKILL)

    def end(self) -> int | None:
        """Wait for the end; None if it hung, which ends it."""
        try:
            return self.process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            return None

    def outlived(self) -> dict[int, str]:
        """Return the processes that are left some time after the end, and end them."""
        deadline = time.monotonic() + LEAVING_S
        while (left := self.family()) and time.monotonic() < deadline:
            time.sleep(0.05)
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return left


def temporaries(folder: Path) -> list[str]:
    """Return the names of temporary files below a folder; lock files are not."""
    hidden = [p for p in folder.rglob("*") if p.name.startswith(".") and p.name != ".lock"]
    return sorted(map(str, [*hidden, *(folder / "tmp").glob("*")]))


def delay(rng: random.Random, whole_s: float) -> float:
    """A time of a kill: the first milliseconds, any time, or near the end, where files appear."""
    kind = rng.random()
    if kind < 0.15:
        return rng.uniform(0.0, 0.02)
    if kind < 0.6:
        return rng.uniform(0.0, whole_s)
    return rng.uniform(0.7 * whole_s, 1.1 * whole_s)


class Tally:
    """Counts of kills and problems, with a line for each problem."""

    def __init__(self, name: str):
        self.name, self.kills, self.after_end = name, 0, 0
        self.problems: Counter[str] = Counter()
        self.notes: list[str] = []
        self.began = time.monotonic()

    def problem(self, kind: str, text: str) -> None:
        self.problems[kind] += 1
        self.notes.append(f"{kind}: {text[-600:]}")
        sys.stderr.write(f"{self.name}: {self.notes[-1]}\n")

    def row(self) -> dict[str, object]:
        counts = {kind: self.problems[kind] for kind in PROBLEMS}
        seconds = round(time.monotonic() - self.began, 1)
        return {"what": self.name, "kills": self.kills, "after the end": self.after_end, **counts,
                "seconds": seconds, "notes": self.notes}  # fmt: skip


def make_inputs(folder: Path, rng: np.random.Generator) -> dict[str, Path]:
    """Write estimates of three estimators, and outcomes of the first one's trials."""
    made = {}
    for name in ("a", "b", "c"):
        truth = DATA.ground_truth
        twists = rng.normal(size=(len(truth.obj_id), 6)) * ([0.01] * 3 + [0.1] * 3)
        poses = truth.cam_T_obj @ exp(twists)
        made[name] = folder / f"{name}_ycbv-test.csv"
        n = len(poses)
        fields = (truth.scene_id, truth.im_id, truth.obj_id, np.ones(n), poses)
        write_results(made[name], Results(*fields, np.ones(n), np.arange(n)))
        if name == "a":
            table = read_results(made[name])
            rows = pl.DataFrame(
                {"scene_id": table.scene_id, "im_id": table.im_id, "obj_id": table.obj_id}
            ).with_columns(
                estimator=pl.lit("a"),
                dataset=pl.lit("ycbv"),
                est_id=pl.lit(0),
                gripper=pl.lit(GRIPPER),
                grasp=pl.lit("reference"),
                success=(np.linalg.norm(twists[:, :3], axis=1) < 0.02).astype(int),
            )
            made["outcomes"] = folder / "outcomes.csv"
            write_table(made["outcomes"], rows.select(*TRIAL_COLUMNS, "success"))
    return made


def verbs(made: dict[str, Path], folder: Path, out: Path) -> dict[str, list[str]]:
    """Arguments of every verb that writes and runs on the demonstration data, by its name."""
    root, boxes = str(DATA.root), DATA.root / "test_detections_jittered.json"
    mine = ["--estimates", f"a={made['a']}", "--bop", root]
    everyone = [*mine, "--estimates", f"b={made['b']}", "--estimates", f"c={made['c']}"]
    outcomes = ["--outcomes", str(made["outcomes"])]
    first = DATA.images[0] if isinstance(DATA.images, list) else sorted(DATA.images)[0]
    image = ["--image", f"{first[0]}/{first[1]}"]
    copy = "import shutil, sys, time; time.sleep(0.5); shutil.copy(sys.argv[1], sys.argv[2])"
    command = shlex.join([sys.executable, "-S", "-c", copy, str(made["a"])]) + " {out}"
    model, certificate = folder / "model.npz", folder / "certificate.json"
    sphere = ["--object", "ycbv-5", "--gripper", GRIPPER]
    return {
        "train": ["train", *everyone, "--scenes", "0-19", "--principal", "a", "--gripper", GRIPPER,
                  *outcomes, "--folds", "0", "--trees", "10", "--out", f"{out}.npz"],
        "predict": ["predict", *everyone, "--scenes", "20-30", "--model", str(model),
                    "--out", f"{out}.csv"],
        "certify": ["certify", *everyone, "--scenes", "20-30", "--model", str(model), *outcomes,
                    "--unit", "image", "--rate", "0.6", "--out", f"{out}.json"],
        "monitor": ["monitor", "--certificate", str(certificate), "--attempt-log",
                    str(made["outcomes"]), "--state", f"{out}.json"],
        "errors": ["errors", *everyone, "--scenes", "0-3", "--out", f"{out}.csv"],
        "estimate": ["estimate", "--bop", root, "--detections", str(boxes), "--estimator", command,
                     "--out", f"{out}_ycbv-test.csv"],
        "compare": ["compare", *everyone, "--scenes", "0-5", "--gripper", GRIPPER, *outcomes,
                    "--trees", "5", "--folds", "2", "--bootstrap", "50", "--json", f"{out}.json"],
        "fit-grasp": ["fit-grasp", *mine, *outcomes, *sphere, "--scenes", "0-3", "--budget",
                      "0.01", "--out", f"{out}.toml"],
        "render": ["render", "--scenes", "1", "--images", "2", "--out", f"{out}-ycbv"],
        "grasps": ["grasps", "--objects", "ycbv-5", "--gripper", GRIPPER, "--size", "96",
                   "--out", f"{out}.png"],
        "watch": ["watch", *sphere, "--size", "160x120", "--out", f"{out}.gif"],
        "overlay": ["overlay", *mine, *image, "--size", "160", "--out", f"{out}.png"],
    }  # fmt: skip


def kill_campaigns(count: int, made: dict[str, Path], folder: Path, rng: random.Random) -> Tally:
    """Kill campaigns ``count`` times."""
    common = ["simulate", "--estimates", f"a={made['a']}", "--bop", str(DATA.root), "--gripper",
              GRIPPER, "--scenes", "0-3", "--workers", "2", "--out"]  # fmt: skip
    whole = folder / "whole"
    run = Run([*common, str(whole)], folder)
    assert run.end() == 0, run.said.read_text()
    seconds = time.monotonic() - run.started
    reference = Store(whole).outcomes()
    tally, number = Tally("simulate"), 0
    while tally.kills < count:
        number += 1
        out = folder / f"campaign{number}"
        kept = reference.clear()
        while tally.kills < count and not (out / "outcomes.parquet").exists():
            target = TARGETS[tally.kills % 3]
            kept = one_kill([*common, str(out)], out, folder, target, kept, seconds, tally, rng)
        last = Run([*common, str(out)], folder)
        if last.end() != 0:
            tally.problem("damaged", f"cannot be resumed: {last.said.read_text()}")
        check_whole(out, reference, kept, tally)
        if left := [name for name in temporaries(out) if "campaign" in name]:
            tally.problem("left", f"{left}")
        shutil.rmtree(out, ignore_errors=True)
        progress(tally, count)
    return tally


def one_kill(
    arguments: list[str], out: Path, folder: Path, target: str, kept: pl.DataFrame,
    seconds: float, tally: Tally, rng: random.Random,
) -> pl.DataFrame:  # fmt: skip
    """Kill a campaign once; return the outcomes that it then holds."""
    run = Run(arguments, folder)
    if target == "worker":
        while not run.workers() and run.process.poll() is None:
            time.sleep(0.001)
        time.sleep(rng.choice([rng.uniform(0, 0.02), rng.uniform(0, 1), rng.uniform(0, seconds)]))
    else:
        time.sleep(delay(rng, seconds))
    tally.after_end += run.process.poll() is not None
    run.kill(target)
    tally.kills += 1
    code = run.end()
    if code is None:
        tally.problem("hung", f"{target} killed: {run.said.read_text()}")
    elif target == "worker" and code not in (0, 2):
        tally.problem("damaged", f"exit code {code} for a worker: {run.said.read_text()}")
    if left := run.outlived():
        tally.problem("left", f"{target} killed: {left}")
    try:
        now = Store(out).outcomes() if (out / "manifest.json").exists() else kept.clear()
    except GraspcastError as error:
        tally.problem("damaged", str(error))
        return kept
    # Its computing time tells an outcome from that of the same trial run again.
    missing = kept.join(now, on=kept.columns, how="anti", nulls_equal=True)
    if len(missing):
        again = missing.join(now, on=list(TRIAL_COLUMNS), how="semi")
        tally.problem("doubled" if len(again) else "lost", f"{len(missing)} after {target}")
    return now


def check_whole(out: Path, reference: pl.DataFrame, kept: pl.DataFrame, tally: Tally) -> None:
    """Compare a complete campaign with one that nobody killed."""
    try:
        stored = pl.read_parquet(out / "outcomes.parquet")
    except (OSError, pl.exceptions.PolarsError) as error:
        tally.problem("damaged", str(error))
        return
    keys = list(TRIAL_COLUMNS)
    if stored.select(keys).is_duplicated().any():
        tally.problem("doubled", f"{out} has trials twice")
    if len(kept.join(stored, on=kept.columns, how="anti", nulls_equal=True)):
        tally.problem("doubled", f"{out} has run trials again that were stored")
    if len(reference.join(stored, on=keys, how="anti")):
        tally.problem("lost", f"{out} lacks trials")
    elif not stored.drop("computed_s").equals(reference.drop("computed_s")):
        tally.problem("damaged", f"{out} has other outcomes")


def content(path: Path) -> object:
    """Return what a file or directory holds, to compare; None if there is none."""
    if path.is_dir():
        return {str(p.relative_to(path)): p.stat().st_size for p in path.rglob("*") if p.is_file()}
    return path.read_bytes() if path.exists() else None


def kill_verb(
    name: str, arguments: Callable[[Path], list[str]], count: int, folder: Path, rng: random.Random
) -> Tally:
    """Kill a verb ``count`` times, half of the times with an old output in the way."""
    tally = Tally(name)
    folder.mkdir()
    asked = arguments(folder / "out" / "x")
    out = Path(asked[-1])
    wholes, seconds = [], 0.0
    for _ in range(2):
        remove(out.parent)
        run = Run(asked, folder)
        if run.end() != 0:
            tally.problem("damaged", f"does not run at all: {run.said.read_text()}")
            return tally
        seconds = time.monotonic() - run.started
        wholes.append(content(out))
    same = wholes[0] == wholes[1]  # a file that has a date is compared by its size, roughly
    for i in range(count):
        before: object = None
        if i % 2 and not isinstance(wholes[0], dict) and name != "monitor":
            out.parent.mkdir(exist_ok=True)
            out.write_bytes(b"old")
            before = b"old"
        run = Run(asked, folder)
        time.sleep(delay(rng, seconds))
        tally.after_end += run.process.poll() is not None
        run.kill(("parent", "group")[i % 3 == 0])
        tally.kills += 1
        if run.end() is None:
            tally.problem("hung", "after a kill")
        if left := run.outlived():
            tally.problem("left", f"{left}")
        now = content(out)
        if now != before and (now != wholes[0] if same else not alike(now, wholes[0])):
            tally.problem("damaged", f"{out} is neither what was there before nor whole")
        if i % 5 == 4 or i == count - 1:
            again = Run(asked, folder)
            occupied = isinstance(now, dict)  # a complete directory is not replaced
            if (code := again.end()) != 0 and not occupied:
                tally.problem("damaged", f"exit code {code} then: {again.said.read_text()}")
            if not occupied and (left_files := temporaries(folder)):
                tally.problem("left", f"{left_files}")
            remove(out.parent)
        elif out.exists():
            remove(out)
    progress(tally, count)
    return tally


def alike(now: object, whole: object) -> bool:
    if isinstance(now, bytes) and isinstance(whole, bytes):
        return abs(len(now) - len(whole)) <= 0.1 * len(whole)
    return isinstance(now, dict) and isinstance(whole, dict) and now.keys() == whole.keys()


def remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def progress(tally: Tally, count: int) -> None:
    sys.stderr.write(f"{tally.name}: {tally.kills} of {count}, {dict(tally.problems) or 'fine'}\n")


def measured(options: argparse.Namespace, folder: Path) -> Iterator[Tally]:
    rng = random.Random(options.seed)
    random.seed(options.seed)
    made = make_inputs(folder, np.random.default_rng(options.seed))
    every = verbs(made, folder, folder / "unused")
    wanted = options.verbs if options.verbs is not None else list(every)
    if options.campaigns:
        yield kill_campaigns(options.campaigns, made, folder, rng)
    for name, suffix in (("train", ".npz"), ("certify", ".json")):
        words = verbs(made, folder, folder / {"train": "model", "certify": "certificate"}[name])
        if {"predict", "certify", "monitor", name} & set(wanted):
            run = Run(words[name], folder)
            if run.end() != 0:
                raise SystemExit(f"{name}{suffix}: {run.said.read_text()}")
    for name in wanted:

        def arguments(out: Path, name: str = name) -> list[str]:
            return verbs(made, folder, out)[name]

        yield kill_verb(name, arguments, options.each, folder / name, rng)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=500, help="kills of campaigns")
    parser.add_argument("--each", type=int, default=100, help="kills of each other verb")
    parser.add_argument("--verbs", nargs="*", metavar="VERB", help="other verbs; all by default")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kills-") as scratch:
        rows = [tally.row() for tally in measured(options, Path(scratch))]
    columns = ("what", "kills", "after the end", *PROBLEMS, "seconds")
    for line in (columns, *([row[c] for c in columns] for row in rows)):
        print("  ".join(f"{cell!s:>13}" for cell in line))
    if options.json:
        options.json.write_text(json.dumps({"seed": options.seed, "rows": rows}, indent=1))
    return int(any(row[kind] for row in rows for kind in PROBLEMS))


if __name__ == "__main__":
    sys.exit(main())

"""Kills (SIGKILL) of campaigns and of every verb that writes: what is lost, damaged or left behind.

    python benchmarks/kills.py --campaigns 500 --each 100 --json kills.json

Linux only. Inputs are the demonstration data of the package, with estimates and outcomes drawn from
a seed; verbs that need the published trials are killed with ``--data``; these and the demonstration
are killed a tenth as often. A campaign is killed (its
parent, its whole process group, or one worker), looked at, and started again, until it is complete;
then its outcomes are compared with those of a campaign that nobody killed. A verb's output, after a
kill, must be what was there before or whole; after every tenth kill the verb runs to its end, must
sweep, and must give what an undisturbed run gives. Every tenth round begins without compiled code.
Only kills that met a living process are counted. The JSON is written as rounds end; with the same
JSON, an interrupted run goes on.

    lost       outcomes that were stored are gone, or a complete output is missing some
    doubled    trials that are stored twice, or that were run again though they were stored
    damaged    a file that is neither what was there before nor whole, or a run that then fails
    hung       a process that does not end within five minutes
    left       processes that outlive their parent by 15 s; temporary files after the next run
"""

from __future__ import annotations

import argparse
import compileall
import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl

import graspcast
from graspcast.bop.results import Results, read_results, write_results
from graspcast.demo_data import demo_dataset
from graspcast.errors import GraspcastError
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.io.tables import write_table
from graspcast.pose.transforms import exp
from graspcast.simulation.campaign.store import COLUMNS, Store

PROBLEMS = ("lost", "doubled", "damaged", "hung", "left")
LONGEST_S, LEAVING_S = 300.0, 15.0
TARGETS = ("parent", "group", "worker")
DATA = demo_dataset()
GRIPPER = "parallel"
TOKEN = "GRASPCAST_KILLS"
A_ROUND = 10
STOP = threading.Event()
LIVE: set[Run] = set()


class InterruptedRunError(Exception):
    """The benchmark was interrupted; what happens now means nothing."""


class Run:
    """A run of ``graspcast`` in a session of its own; its descendants carry a token."""

    def __init__(self, arguments: list[str], folder: Path, cold: bool = False):
        if STOP.is_set():
            raise InterruptedRunError
        self.token = f"{folder}:{uuid.uuid4().hex}"
        temporary = folder / "tmp"
        temporary.mkdir(exist_ok=True, parents=True)
        self.said = folder / "stderr"
        environment = {**os.environ, TOKEN: self.token, "TMPDIR": str(temporary)}
        if cold:
            environment["NUMBA_CACHE_DIR"] = str(folder / "numba")
        self.started = time.monotonic()
        with self.said.open("wb") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "graspcast", *arguments],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                start_new_session=True,
            )
        LIVE.add(self)

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

    def kill(self, target: str, rng: random.Random) -> bool:
        """Kill the parent, its process group or a worker; return False if it had ended."""
        if self.process.poll() is not None:
            return False
        with suppress(ProcessLookupError):
            if target == "group":
                os.killpg(self.process.pid, signal.SIGKILL)
            elif target == "parent":
                os.kill(self.process.pid, signal.SIGKILL)
            elif workers := self.workers():
                os.kill(rng.choice(workers), signal.SIGKILL)
            else:
                return False
            return True
        return False

    def sleep(self, seconds: float) -> None:
        """Wait for a time, or until the process ends."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)

    def end(self) -> int | None:
        """Wait for the end; None if it hung, which ends it."""
        try:
            return self.process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            return None
        finally:
            LIVE.discard(self)
            if STOP.is_set():
                raise InterruptedRunError

    def outlived(self) -> dict[int, str]:
        """Return the processes that are left some time after the end, and end them."""
        deadline = time.monotonic() + LEAVING_S
        while (left := family(self.token)) and time.monotonic() < deadline:
            time.sleep(0.05)
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        return left


def family(token: str) -> dict[int, str]:
    """Command lines of all living processes whose token begins so, by pid."""
    wanted, found = f"{TOKEN}={token}".encode(), {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                if wanted in (entry / "environ").read_bytes():
                    line = (entry / "cmdline").read_bytes()
                    found[int(entry.name)] = line.replace(b"\0", b" ").decode(errors="replace")
    return found


def temporaries(folder: Path) -> list[str]:
    """Return the names of temporary files below a folder; lock files are not.

    Nor is ``.ses``, which ONNX Runtime writes into the temporary directory when it is imported.
    """
    hidden = [p for p in folder.rglob(".*") if p.name not in (".lock", ".ses")]
    numba = (folder / "numba").rglob("*.tmp.*")
    return sorted({str(p) for p in (*hidden, *(folder / "tmp").glob("[!.]*"), *numba)})


def delay(rng: random.Random, whole_s: float) -> float:
    """A time of a kill: the first milliseconds, any time, or near the end, where files appear."""
    kind = rng.random()
    if kind < 0.2:
        return rng.uniform(0.0, 0.02)
    if kind < 0.6:
        return rng.uniform(0.0, 0.6 * whole_s)
    return rng.uniform(0.6 * whole_s, 1.05 * whole_s)


@dataclass
class Tally:
    """Counts of kills and problems, with a line for each problem."""

    what: str
    rounds: int = 0
    by: Counter[str] = field(default_factory=Counter)
    after_end: int = 0
    seconds: float = 0.0
    problems: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    @property
    def kills(self) -> int:
        return sum(self.by.values())

    def problem(self, kind: str, text: str) -> None:
        if STOP.is_set():
            raise InterruptedRunError
        self.problems[kind] += 1
        self.notes.append(f"{kind}: {text[-600:]}")
        sys.stderr.write(f"{self.what}: {self.notes[-1]}\n")

    def add(self, other: Tally) -> None:
        self.rounds += other.rounds
        self.by += other.by
        self.after_end += other.after_end
        self.seconds = round(self.seconds + other.seconds, 1)
        self.problems += other.problems
        self.notes += other.notes

    def row(self) -> dict[str, object]:
        counts = {kind: self.problems[kind] for kind in PROBLEMS}
        return {"what": self.what, "kills": self.kills, "after the end": self.after_end, **counts,
                "rounds": self.rounds, "seconds": self.seconds, "by": dict(self.by),
                "notes": self.notes}  # fmt: skip

    @classmethod
    def of(cls, row: dict[str, object]) -> Tally:
        """Return the tally that has this row."""
        problems = Counter({kind: row[kind] for kind in PROBLEMS})
        return cls(row["what"], row["rounds"], Counter(row["by"]), row["after the end"],
                   row["seconds"], problems, row["notes"])  # type: ignore[arg-type]  # fmt: skip


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
    first = sorted(DATA.images)[0]
    image = ["--image", f"{first[0]}/{first[1]}"]
    copy = "import shutil, sys, time; time.sleep(0.5); shutil.copy(sys.argv[1], sys.argv[2])"
    command = shlex.join([sys.executable, "-S", "-c", copy, str(made["a"])]) + " {out}"
    model, certificate = folder / "model.npz", folder / "certificate.json"
    verdicts = folder / "verdicts.csv"
    sphere = ["--object", "ycbv-5", "--gripper", GRIPPER]
    return {
        "train": ["train", *everyone, "--scenes", "1-4", "--objects", "5", "9", "--principal", "a",
                  "--gripper", GRIPPER, *outcomes, "--folds", "0", "--trees", "4",
                  "--out", f"{out}.npz"],
        "predict": ["predict", *everyone, "--scenes", "20-30", "--objects", "5", "9",
                    "--model", str(model), "--out", f"{out}.csv"],
        "score": ["score", "--verdicts", str(verdicts), *outcomes, "--json", f"{out}.json"],
        "certify": ["certify", *everyone, "--scenes", "20-30", "--objects", "5", "9", "--model",
                    str(model), *outcomes, "--unit", "image", "--rate", "0.6",
                    "--out", f"{out}.json"],
        "monitor": ["monitor", "--certificate", str(certificate), "--attempt-log",
                    str(made["outcomes"]), "--state", f"{out}.json"],
        "errors": ["errors", *everyone, "--scenes", "1", "--objects", "5", "--out", f"{out}.csv"],
        "estimate": ["estimate", "--bop", root, "--detections", str(boxes), "--estimator", command,
                     "--out", f"{out}_ycbv-test.csv"],
        "compare": ["compare", *everyone, "--scenes", "1-4", "--objects", "5", "9", "--gripper",
                    GRIPPER, *outcomes, "--trees", "2", "--folds", "2", "--bootstrap", "10",
                    "--json", f"{out}.json"],
        "fit-grasp": ["fit-grasp", *mine, *outcomes, *sphere, "--scenes", "1-2", "--budget",
                      "0.001", "--out", f"{out}.toml"],
        "render": ["render", "--scenes", "1", "--images", "2", "--out", f"{out}-ycbv"],
        "grasps": ["grasps", "--objects", "ycbv-5", "--gripper", GRIPPER, "--size", "96",
                   "--out", f"{out}.png"],
        "watch": ["watch", *sphere, "--size", "160x120", "--out", f"{out}.gif"],
        "overlay": ["overlay", *mine, *image, "--size", "160", "--out", f"{out}.png"],
    }  # fmt: skip


def slow_verbs(data: Path | None, folder: Path, out: Path) -> dict[str, list[str]]:
    """Arguments of the demonstration, and of the verbs that need the published trials."""
    demo = {"demo": ["demo", "--data", str(folder / "ycbv"), "--out", str(out)]}
    if data is None:
        return demo
    at = ["--data", str(data)]
    release = data / "raw" / "Consensus-Driven-Uncertainty"
    return {
        **demo,
        "evaluate": ["evaluate", *at, "--methods", "majority", "--protocols", "random_split",
                     "--bootstrap", "10", "--work", f"{out}.work", "--json", f"{out}.json"],
        "reproduce": ["reproduce", *at, "--json", f"{out}.json"],
        "validate-sim": ["validate-sim", *at, "--workers", "2", "--json", f"{out}.json",
                         "--out", str(out)],
        "import-release": ["import-release", str(release), str(out)],
    }  # fmt: skip


class Campaigns:
    """Kills of campaigns."""

    def __init__(self, made: dict[str, Path], folder: Path):
        self.arguments = ["simulate", "--estimates", f"a={made['a']}", "--bop", str(DATA.root),
                          "--gripper", GRIPPER, "--scenes", "1", "--workers", "2",
                          "--out"]  # fmt: skip
        self.folder, self.lock = folder, threading.Lock()
        self.seconds, self.reference = 0.0, pl.DataFrame(schema=COLUMNS)

    def prepare(self) -> None:
        """Run a campaign that nobody kills."""
        with self.lock:
            if len(self.reference) == 0:
                run = Run([*self.arguments, str(self.folder / "whole")], self.folder)
                if run.end() != 0:
                    raise SystemExit(run.said.read_text())
                self.seconds = time.monotonic() - run.started
                self.reference = Store(self.folder / "whole").outcomes()

    def __call__(self, folder: Path, rng: random.Random, tally: Tally) -> None:
        """Kill a campaign until it is complete; then compare it."""
        self.prepare()
        out = folder / "campaign"
        kept = self.reference.clear()
        kills = 0
        while kills < A_ROUND and not (out / "outcomes.parquet").exists():
            target = TARGETS[rng.randrange(3)]
            share = 0.5 + 0.5 * (1 - len(kept) / len(self.reference))  # loading, and trials
            began, asked = time.monotonic(), [*self.arguments, str(out)]
            kept, met = one_kill(asked, out, folder, target, kept, share * self.seconds, tally, rng)
            if not met:
                self.seconds = 0.7 * self.seconds + 0.3 * (time.monotonic() - began) / share
            kills += 1
        last = Run([*self.arguments, str(out)], folder)
        if last.end() != 0:
            tally.problem("damaged", f"cannot be resumed: {last.said.read_text()}")
        check_whole(out, self.reference, kept, tally)
        if left := temporaries(folder):
            tally.problem("left", f"{left}")


def one_kill(
    arguments: list[str], out: Path, folder: Path, target: str, kept: pl.DataFrame,
    seconds: float, tally: Tally, rng: random.Random,
) -> tuple[pl.DataFrame, bool]:  # fmt: skip
    """Kill a campaign once; return the outcomes that it then holds, and if the kill met it."""
    run = Run(arguments, folder)
    if target == "worker":
        while not run.workers() and run.process.poll() is None:
            time.sleep(0.001)
        run.sleep(rng.choice([rng.uniform(0, 0.02), rng.uniform(0, 1), rng.uniform(0, seconds)]))
    else:
        run.sleep(delay(rng, seconds))
    if met := run.kill(target, rng):
        tally.by[target] += 1
    else:
        tally.after_end += 1
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
        return kept, met
    # Its computing time tells an outcome from that of the same trial run again.
    missing = kept.join(now, on=kept.columns, how="anti", nulls_equal=True)
    if len(missing):
        again = missing.join(now, on=list(TRIAL_COLUMNS), how="semi")
        tally.problem("doubled" if len(again) else "lost", f"{len(missing)} after {target}")
    return now, met


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
    if not (out / "README.md").exists():
        tally.problem("damaged", f"{out} has no dataset card")


class LongCampaign:
    """Kills of ``validate-sim``, which takes too long to be complete."""

    def __init__(self, arguments: Callable[[Path], list[str]]):
        self.arguments = arguments

    def __call__(self, folder: Path, rng: random.Random, tally: Tally) -> None:
        """Kill it a few times; what is stored stays."""
        kept = pl.DataFrame(schema=COLUMNS)
        out = folder / "out"
        while tally.kills < A_ROUND // 2:
            target = TARGETS[rng.randrange(3)]
            kept, _ = one_kill(self.arguments(out), out, folder, target, kept, 40.0, tally, rng)


class Verb:
    """Kills of a verb, half of the times with an old output in the way."""

    def __init__(self, name: str, arguments: Callable[[Path], list[str]], folder: Path):
        self.name, self.arguments, self.folder = name, arguments, folder
        self.lock = threading.Lock()
        self.wholes: list[object] = []
        self.seconds: dict[bool, float] = {}

    def prepare(self, tally: Tally) -> bool:
        """Run it twice undisturbed: files that differ have a date, and are compared roughly."""
        with self.lock:
            for i in range(2 - len(self.wholes)):
                folder = self.folder / f"whole-{self.name}{i}"
                out, run = self.start(folder)
                if run.end() not in (0, 3):
                    tally.problem("damaged", f"does not run at all: {run.said.read_text()}")
                    return False
                self.seconds[False] = time.monotonic() - run.started
                self.wholes.append(content(out))
                shutil.rmtree(folder)
            return True

    def start(self, folder: Path, cold: bool = False) -> tuple[Path, Run]:
        asked = self.arguments(folder / "out" / "x")
        return Path(asked[-1]), Run(asked, folder, cold)

    def whole(self, now: object) -> bool:
        if self.wholes[0] == self.wholes[1]:
            return now == self.wholes[0]
        return alike(now, self.wholes[0])

    def torn(self, now: object) -> list[str]:
        """Return the files of a directory that are not as in one that is whole."""
        one, two = self.wholes
        assert isinstance(now, dict) and isinstance(one, dict) and isinstance(two, dict)
        # The sizes of a campaign's files depend on times and on the directory's name.
        same = {name for name in one if one[name] == two.get(name) and "trials/" not in name}
        return [
            name
            for name, size in now.items()
            if (name not in one and "shards/" not in name) or (name in same and size != one[name])
        ]

    def __call__(self, folder: Path, rng: random.Random, tally: Tally) -> None:
        """Kill it ten times; then let it end."""
        if not self.prepare(tally):
            return
        cold = rng.random() < 0.1
        many = isinstance(self.wholes[0], dict)
        for i in range(A_ROUND):
            out = Path(self.arguments(folder / "out" / "x")[-1])
            before: object = None
            if i % 2 and not many and self.name != "monitor":
                out.parent.mkdir(exist_ok=True, parents=True)
                out.write_bytes(b"# old\n")
                before = b"# old\n"
            out, run = self.start(folder, cold)
            run.sleep(delay(rng, self.seconds.get(cold, 2 * self.seconds[False])))
            if run.kill(target := ("parent", "group")[rng.randrange(2)], rng):
                tally.by[target] += 1
            else:
                tally.after_end += 1
                self.seconds[cold] = min(
                    self.seconds.get(cold, LONGEST_S), time.monotonic() - run.started
                )
            if run.end() is None:
                tally.problem("hung", "after a kill")
            if left := run.outlived():
                tally.problem("left", f"{left}")
            now = content(out)
            parts = self.name in ("demo", "import-release") and now is not None
            if parts and (torn := self.torn(now)):
                tally.problem("damaged", f"{out} holds files that are not whole: {torn}")
            if (out / "trials" / "manifest.json").exists():
                try:
                    Store(out / "trials").outcomes()
                except GraspcastError as error:
                    tally.problem("damaged", str(error))
            if not parts and now != before and not self.whole(now):
                tally.problem("damaged", f"{out} is neither what was there before nor whole")
            if i < A_ROUND - 1 and not parts:
                remove(out)
        self.finish(folder, cold, tally)

    def finish(self, folder: Path, cold: bool, tally: Tally) -> None:
        """Run it to its end over what the last kill left."""
        out = Path(self.arguments(folder / "out" / "x")[-1])
        before = content(out)
        out, run = self.start(folder, cold)
        code = run.end()
        if isinstance(before, dict) and self.name == "render":
            return  # a complete directory is not replaced
        if code not in (0, 3):
            tally.problem("damaged", f"exit code {code} then: {run.said.read_text()}")
        else:
            self.seconds[cold] = time.monotonic() - run.started
        if not self.whole(content(out)):
            tally.problem("damaged", f"{out} is not whole after a complete run")
        if left := temporaries(folder):
            tally.problem("left", f"{left}")


def content(path: Path) -> object:
    """Return what a file or directory holds, to compare; None if there is none."""
    if path.is_dir():
        return {str(p.relative_to(path)): p.stat().st_size for p in path.rglob("*") if p.is_file()
                and not p.name.startswith(".")}  # fmt: skip
    return path.read_bytes() if path.exists() else None


def alike(now: object, whole: object) -> bool:
    if isinstance(now, bytes) and isinstance(whole, bytes):
        return abs(len(now) - len(whole)) <= 0.1 * len(whole)
    return isinstance(now, dict) and isinstance(whole, dict) and now.keys() == whole.keys()


def remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


class Benchmark:
    """Rounds of kills in several lanes; counts are kept in a JSON."""

    def __init__(self, options: argparse.Namespace, folder: Path):
        self.options, self.folder, self.lock = options, folder, threading.Lock()
        self.tallies: dict[str, Tally] = {}
        if options.json and options.json.exists():
            rows = json.loads(options.json.read_text())["rows"]
            self.tallies = {row["what"]: Tally.of(row) for row in rows}
        self.wanted: dict[str, int] = {}
        self.rounds: dict[str, Callable[[Path, random.Random, Tally], None]] = {}
        self.flying: Counter[str] = Counter()
        self.begun: Counter[str] = Counter()

    def prepare(self) -> None:
        """Make the inputs, and one round of each kind."""
        options, folder = self.options, self.folder
        made = make_inputs(folder, np.random.default_rng(options.seed))
        names = list(verbs(made, folder, folder))
        names += list(slow_verbs(options.data, folder, folder))
        names = names if options.verbs is None else options.verbs
        for name, made_as in (("train", "model"), ("predict", "verdicts"),
                              ("certify", "certificate")):  # fmt: skip
            if {"predict", "score", "certify", "monitor"} & set(names):
                run = Run(verbs(made, folder, folder / made_as)[name], folder)
                if run.end() != 0:
                    raise SystemExit(run.said.read_text())
        if "demo" in names:
            tables = ["render", "--scenes", "6", "--images", "2", "--out", str(folder / "ycbv")]
            Run(tables, folder).end()
        for name in names:

            def arguments(out: Path, name: str = name) -> list[str]:
                slow = slow_verbs(options.data, folder, out)
                return {**verbs(made, folder, out), **slow}[name]

            quick = name in verbs(made, folder, folder)
            kind = LongCampaign(arguments) if name == "validate-sim" else None
            self.rounds[name] = kind or Verb(name, arguments, folder)
            self.wanted[name] = options.each if quick else -(-options.each // 10)
        if options.campaigns:
            self.rounds["simulate"] = Campaigns(made, folder)
            self.wanted["simulate"] = options.campaigns
        for name in self.wanted:
            self.tallies.setdefault(name, Tally(name))

    def next(self) -> str | None:
        """Return what lags behind most; None if all is done or under way."""

        def share(name: str) -> float:
            return (self.tallies[name].kills + self.flying[name]) / max(self.wanted[name], 1)

        open_ = [name for name in self.wanted if share(name) < 1]
        return min(open_, key=share) if open_ else None

    def lane(self) -> None:
        with suppress(InterruptedRunError):
            while True:
                with self.lock:
                    if (name := self.next()) is None:
                        return
                    self.flying[name] += A_ROUND
                    self.begun[name] += 1
                    number = self.tallies[name].rounds + self.begun[name]
                self.one_round(name, number)

    def one_round(self, name: str, number: int) -> None:
        tally, began = Tally(name, 1), time.monotonic()
        folder = self.folder / f"{name}-{number}-{uuid.uuid4().hex[:8]}"
        folder.mkdir()
        self.rounds[name](folder, random.Random(f"{self.options.seed} {folder.name}"), tally)
        if STOP.is_set():
            raise InterruptedRunError
        shutil.rmtree(folder, ignore_errors=True)
        tally.seconds = time.monotonic() - began
        with self.lock:
            self.flying[name] -= A_ROUND
            self.begun[name] -= 1
            total = self.tallies[name]
            total.add(tally)
            if tally.problems and not tally.kills:
                self.wanted[name] = 0  # it does not run at all
            state = dict(total.problems) or "fine"
            sys.stderr.write(f"{name}: {total.kills} of {self.wanted[name]}, {state}\n")
            self.save()

    def save(self) -> None:
        if (path := self.options.json) is not None:
            rows = [tally.row() for tally in self.tallies.values()]
            part = path.with_name(path.name + ".part")
            part.write_text(json.dumps({"seed": self.options.seed, "rows": rows}, indent=1))
            part.replace(path)


def stop(*_: object) -> None:
    """Stop all lanes, and end what they run."""
    STOP.set()
    for run in list(LIVE):
        with suppress(ProcessLookupError):
            os.killpg(run.process.pid, signal.SIGKILL)


def running(pid: str) -> bool:
    try:
        return bool(Path("/proc", pid, "cmdline").read_bytes())  # that of a zombie is empty
    except OSError:
        return False


def sweep() -> None:
    """End and remove what a killed run of this script left."""
    for path in Path(tempfile.gettempdir()).glob("kills-*-*"):
        pid = path.name.split("-")[1]
        if pid.isdecimal() and not running(pid):
            for left in family(str(path)):
                with suppress(ProcessLookupError):
                    os.kill(left, signal.SIGKILL)
            shutil.rmtree(path, ignore_errors=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=500, help="kills of campaigns")
    parser.add_argument("--each", type=int, default=100, help="kills of each other verb")
    parser.add_argument("--verbs", nargs="*", metavar="VERB", help="other verbs; all by default")
    parser.add_argument("--data", type=Path, metavar="DIR",
                        help="published trials, for the verbs that need them")  # fmt: skip
    parser.add_argument("--lanes", type=int, default=2, help="kills at the same time (default: 2)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="counts; an interrupted run goes on from them")
    options = parser.parse_args()
    sweep()
    compileall.compile_dir(Path(graspcast.__file__).parent, quiet=1)
    for signal_ in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signal_, stop)
    with tempfile.TemporaryDirectory(prefix=f"kills-{os.getpid()}-") as scratch:
        benchmark = Benchmark(options, Path(scratch))
        with suppress(InterruptedRunError), ThreadPoolExecutor(options.lanes) as pool:
            benchmark.prepare()
            for lane in [pool.submit(benchmark.lane) for _ in range(options.lanes)]:
                lane.result()
        for pid in family(scratch):
            os.kill(pid, signal.SIGKILL)
    rows = [tally.row() for tally in benchmark.tallies.values()]
    columns = ("what", "kills", "after the end", *PROBLEMS, "rounds", "seconds")
    for line in (columns, *([row[c] for c in columns] for row in rows)):
        print("  ".join(f"{cell!s:>14}" for cell in line))
    return 130 if STOP.is_set() else int(any(row[kind] for row in rows for kind in PROBLEMS))


if __name__ == "__main__":
    sys.exit(main())

"""Mutation tests: would the tests notice a small fault in the code?

python scripts/mutation.py pose views guarantees [--sample 300] [--seed 0] [--processes 4]

Each mutant is a module with one small fault (scripts/mutants.py says which are made and which are
left out). First the module's own test file runs, then its package's tests, up to the first that
fails: the mutant is killed. What takes far longer than it should counts as killed too. Slow tests
are not run, and tests of published data run where GRASPCAST_DATA says where it is. What Numba
compiles is compiled again for each mutant.

Results are added to a file, one JSON object a line, and what it already answers is not run again:
a run that was stopped goes on, and --again runs survivors again, with new tests. --sample draws as
many mutants from each package; the seed says which.

The mutants are Cosmic Ray's (pip install -e '.[dev,mutation]'). It takes part after part: its
operators mutate any source, also what is decorated and compiled, and leave the running of tests to
us. mutmut 3 puts a switch into every function instead, which compiled ones do not survive, and
forks processes in which tests have run before, which polars' threads do not survive. Here a process
that has imported what all tests import is forked for each run (multiprocessing's fork server), in a
copy of the tree of its own.
"""

from __future__ import annotations

import argparse
import compileall
import json
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from multiprocessing import connection
from pathlib import Path
from py_compile import PycInvalidationMode
from typing import Any

from mutants import Mutant, mutants_of

ROOT = Path(__file__).parents[1]
PRELOADED = ["hypothesis.strategies", "numba", "pytest", "scipy.optimize", "scipy.spatial"]
PRELOADED += ["scipy.stats", "scipy.special", "jaxtyping"]
# Every process works alone, and there are as many of them as processors.
ALONE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1")
ADDOPTS = "--import-mode=importlib --strict-markers"
PYTEST = ["-o", f"addopts={ADDOPTS}", "-p", "no:cacheprovider", "-p", "pytest_timeout"]
PYTEST += ["-x", "-q", "--tb=no"]
KILLED, TIMED_OUT, SURVIVED = "killed", "timed out", "survived"
FACTOR = 6.0
"""What takes so many times as long as without a fault, beside the time to start, hangs."""


def main() -> int:
    parser = _parser()
    options = parser.parse_args()
    for name in options.packages:
        if not files_of(options.root, name):
            parser.error(f"there is no package or module {name!r} in {options.root}/src/graspcast")
    if options.processes < 1:
        parser.error("at least one process is needed")
    if find_spec("cosmic_ray") is None:
        parser.error("Cosmic Ray is not installed: pip install -e '.[dev,mutation]'")
    os.environ.update({**ALONE, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"})
    wanted = _wanted(options)
    results = Results(options.results)
    todo = [m for m in wanted if results.leave_open(m, options.again, options.own)]
    print(f"{len(wanted)} mutants, {len(wanted) - len(todo)} of them with a result", flush=True)
    if todo:
        # By Ctrl-C the run is stopped, and what is known is printed.
        with (
            tempfile.TemporaryDirectory(prefix="mutation-") as scratch,
            suppress(KeyboardInterrupt),
        ):
            Run(Path(scratch), options, results).work(todo)
    print_report(wanted, results, sampled=options.sample is not None)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("packages", nargs="+", help="such as pose, or a module: pose/metrics")
    parser.add_argument("--sample", type=int, metavar="N", help="of each package; default: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, metavar="P")
    parser.add_argument("--results", type=Path, default=ROOT / "mutation.jsonl", metavar="FILE")
    parser.add_argument("--again", action="store_true", help="run survivors again")
    parser.add_argument("--own", action="store_true", help="the module's own tests alone")
    parser.add_argument("--minutes", type=float, help="begin no more mutants after this time")
    parser.add_argument(
        "--patience", type=float, default=40.0, metavar="S", help="a run may take so long to start"
    )
    parser.add_argument("--root", type=Path, default=ROOT, help=argparse.SUPPRESS)
    return parser


def _wanted(options: argparse.Namespace) -> list[Mutant]:
    """Return the mutants that were asked for, in random order."""
    draw = random.Random(options.seed)
    wanted: list[Mutant] = []
    for name in options.packages:
        mutants = all_mutants(options.root, name)
        if options.sample is not None:
            mutants = draw.sample(mutants, min(options.sample, len(mutants)))
        wanted += mutants
    wanted = list({mutant.key: mutant for mutant in wanted}.values())
    draw.shuffle(wanted)
    return wanted


def all_mutants(root: Path, name: str) -> list[Mutant]:
    """Return every mutant of a package or a module, such as ``pose`` or ``pose/metrics``."""
    source = root / "src" / "graspcast"
    files = files_of(root, name)
    return [m for file in files for m in mutants_of(file, file.relative_to(source).as_posix())]


def files_of(root: Path, name: str) -> list[Path]:
    """Return the files of a package or a module; none if there is none."""
    path = root / "src" / "graspcast" / name
    if path.is_dir():
        return sorted(path.rglob("*.py"))
    return [path.with_suffix(".py")] if path.with_suffix(".py").is_file() else []


class Results:
    """What became of mutants, kept in a file of JSON lines."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.of: dict[str, dict[str, Any]] = {}
        if path.exists():
            text = path.read_text(encoding="utf-8")
            if text and not text.endswith("\n"):
                path.write_text(f"{text}\n", encoding="utf-8")
            for line in text.splitlines():
                with suppress(json.JSONDecodeError):  # the end of a run that was killed
                    result = json.loads(line)
                    self.of[result["key"]] = result

    def leave_open(self, mutant: Mutant, again: bool, own: bool) -> bool:
        """Whether the mutant is still to be run."""
        result = self.of.get(mutant.key)
        if result is None:
            return True
        survived = result["outcome"] == SURVIVED
        return survived and (again or (result["own"] and not own))

    def add(self, mutant: Mutant, mutated: str | None, outcome: str, own: bool) -> None:
        diff = mutant.diff(mutated) if mutated is not None else ""
        result = {"key": mutant.key, "module": mutant.module, "operator": mutant.operator}
        result |= {"line": mutant.line, "outcome": outcome, "own": own, "diff": diff}
        self.of[mutant.key] = result
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result) + "\n")


@dataclass
class Place:
    """A copy of the tree, and what runs in it."""

    tree: Path
    mutant: Mutant | None = None
    mutated: str | None = None
    phases: list[tuple[list[str], float]] = field(default_factory=list)
    process: Any = None
    until: float = 0.0

    def begin(self, mutant: Mutant, phases: list[tuple[list[str], float]]) -> None:
        """Write the mutant, and start its first tests."""
        self.mutant, self.mutated, self.phases = mutant, mutant.mutated(), phases
        if self.mutated is not None:
            source = self.tree / "src" / "graspcast" / mutant.module
            source.write_text(self.mutated, encoding="utf-8")
            self.next_phase()

    def next_phase(self) -> None:
        tests, seconds = self.phases.pop(0)
        self.process = _start(self.tree, tests)
        self.until = time.monotonic() + seconds

    def outcome(self) -> str | None:
        """Return what became of the mutant; None while that is open."""
        assert self.process is not None
        if self.process.exitcode is None:
            if time.monotonic() < self.until:
                return None
            _kill(self.process)
            return TIMED_OUT
        self.process.join()
        if self.process.exitcode != 0:
            return KILLED
        if not self.phases:
            return SURVIVED
        self.next_phase()
        return None

    def end(self, original: Path) -> None:
        """Put the module back, with the machine code that belongs to it."""
        assert self.mutant is not None
        file = Path("src", "graspcast", self.mutant.module)
        shutil.copy2(original / file, self.tree / file)
        kept = file.parent / "__pycache__"
        for path in (self.tree / kept).glob(f"{file.stem}.*.nb?"):
            path.unlink()
        for path in (original / kept).glob(f"{file.stem}.*.nb?"):
            shutil.copy2(path, self.tree / kept)
        self.mutant = self.process = None


class Run:
    """A run of the tests for many mutants, in several places at once."""

    def __init__(self, scratch: Path, options: argparse.Namespace, results: Results) -> None:
        self.scratch, self.options, self.results = scratch, options, results
        self.original = scratch / "original"
        kept = shutil.ignore_patterns("__pycache__", ".*_cache", "*.jsonl")
        for name in ("src", "tests"):
            shutil.copytree(options.root / name, self.original / name, ignore=kept)
        shutil.copy2(options.root / "pyproject.toml", self.original)
        # Bytecode goes by the text of a module: two mutants may have one size and one second.
        compileall.compile_dir(
            self.original / "src", quiet=2, invalidation_mode=PycInvalidationMode.CHECKED_HASH
        )

    def work(self, todo: list[Mutant]) -> None:
        """Run the tests for every mutant."""
        seconds = self._measure({mutant.module for mutant in todo})
        places = [Place(self.original.with_name(f"{i}")) for i in range(self.options.processes)]
        for place in places:
            shutil.copytree(self.original, place.tree)
        try:
            self._deal_out(todo, places, seconds)
        finally:
            for place in places:
                if place.process is not None:
                    _kill(place.process)

    def _deal_out(self, todo: list[Mutant], places: list[Place], seconds: dict[str, float]) -> None:
        began, done = time.monotonic(), 0
        limit = 60 * (self.options.minutes or float("inf"))
        waiting = todo[::-1]
        while waiting or any(place.mutant for place in places):
            for place in (place for place in places if place.mutant is None):
                if waiting and time.monotonic() - began < limit:
                    mutant = waiting.pop()
                    place.begin(mutant, self._phases(mutant, seconds))
                    if place.mutated is None:
                        self._note(place, "the same")
                elif waiting:
                    print(f"{len(waiting)} mutants are left for another time")
                    waiting = []
            running = [place.process.sentinel for place in places if place.mutant]
            connection.wait(running, timeout=1.0)
            for place in (place for place in places if place.mutant):
                if outcome := place.outcome():
                    self._note(place, outcome)
                    done += 1
                    if done % 50 == 0:
                        print(f"{done} in {time.monotonic() - began:.0f} s", flush=True)

    def _note(self, place: Place, outcome: str) -> None:
        assert place.mutant is not None
        self.results.add(place.mutant, place.mutated, outcome, self.options.own)
        place.end(self.original)

    def _measure(self, modules: Iterable[str]) -> dict[str, float]:
        """Run the tests of the original, which have to pass; return how long each file takes.

        So that the original has the machine code and bytecode that all will need.
        """
        seconds: dict[str, float] = {}
        packages = sorted({_package_tests(module) for module in modules})
        running = []
        for number, package in enumerate(packages):
            report = self.scratch / f"{number}.json"
            running.append((package, report, _start(self.original, [package], report)))
        for package, report, process in running:
            process.join()
            if process.exitcode != 0:
                output = report.with_suffix(".txt").read_text(encoding="utf-8")
                sys.exit(f"{package} fails without any mutant:\n{output}")
            seconds |= json.loads(report.read_text())
        print(f"the tests take {sum(seconds.values()):.0f} s without any mutant", flush=True)
        return seconds

    def _phases(self, mutant: Mutant, seconds: dict[str, float]) -> list[tuple[list[str], float]]:
        """Return which tests to run one after the other, and how long at most."""
        package, own = _package_tests(mutant.module), own_tests(mutant.module)
        of_package = {name: s for name, s in seconds.items() if name.startswith(f"{package}/")}
        rest = [name for name in of_package if name != own]
        phases = [([own], of_package[own])] if own in of_package else []
        if rest and not self.options.own:
            phases.append((sorted(rest), sum(of_package[name] for name in rest)))
        return [(tests, self.options.patience + FACTOR * long) for tests, long in phases]


def _package_tests(module: str) -> str:
    return f"tests/{module.partition('/')[0]}"


def own_tests(module: str) -> str:
    """Return the test file of a module: ``tests/pose/test_metrics.py`` of ``pose/metrics.py``."""
    folder, _, name = module.rpartition("/")
    return f"tests/{folder}/test_{name}"


def _start(tree: Path, tests: list[str], report: Path | None = None) -> Any:
    """Start a process that runs tests in a copy of the tree."""
    server = "forkserver" in multiprocessing.get_all_start_methods()
    context: Any = multiprocessing.get_context("forkserver" if server else "spawn")
    if server:
        context.set_forkserver_preload(PRELOADED)
    process = context.Process(target=run_tests, args=(tree, tests, report))
    process.start()
    return process


def _kill(process: Any) -> None:
    """End a process and all that it has started."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.join()


def run_tests(tree: Path, tests: list[str], report: Path | None) -> None:
    """Run tests in this process, and end it with pytest's exit code."""
    import pytest

    if hasattr(os, "setsid"):
        os.setsid()
    os.chdir(tree)
    path = tree / "output.txt" if report is None else report.with_suffix(".txt")
    with path.open("w", encoding="utf-8") as output:
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    sys.dont_write_bytecode = report is None
    watch = Watch()
    code = pytest.main([*PYTEST, *tests], plugins=[watch])
    sys.stdout.flush()
    if report is not None:
        report.write_text(json.dumps(watch.seconds), encoding="utf-8")
    os._exit(int(code))


class Watch:
    """A plugin that notes how long each file of tests takes, and lets Hypothesis not shrink."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def pytest_configure(self) -> None:
        from hypothesis import Phase, settings

        found = (Phase.explicit, Phase.generate)
        settings.register_profile("mutation", parent=settings(), phases=found)
        settings.load_profile("mutation")

    def pytest_runtest_logreport(self, report: Any) -> None:
        name = report.nodeid.partition("::")[0]
        self.seconds[name] = self.seconds.get(name, 0.0) + report.duration


def print_report(wanted: list[Mutant], results: Results, sampled: bool) -> None:
    """Print survivors, then how many were killed in each module and package."""
    known = [(m, results.of[m.key]) for m in wanted if m.key in results.of]
    known = [(m, r) for m, r in known if r["outcome"] in (KILLED, TIMED_OUT, SURVIVED)]
    for mutant, result in sorted(known, key=lambda known: (known[0].module, known[0].line)):
        if result["outcome"] == SURVIVED:
            print(f"\n{mutant.module}:{mutant.line} survived\n{result['diff']}")
    print(f"\n{'':32}{'killed':>8}{'timed out':>11}{'survived':>10}{'share':>9}")
    for name, group in _groups(known):
        n = [sum(r["outcome"] == o for _, r in group) for o in (KILLED, TIMED_OUT, SURVIVED)]
        share = f"{100 * (n[0] + n[1]) / sum(n):7.1f} %"
        interval = _interval(n[0] + n[1], sum(n)) if sampled and "/" not in name else ""
        print(f"{name:32}{n[0]:8}{n[1]:11}{n[2]:10}{share}{interval}")


def _groups(known: list[tuple[Mutant, dict[str, Any]]]) -> Iterator[tuple[str, list[Any]]]:
    """Yield modules and packages, by name, with what is known of them."""
    names = {m.module for m, _ in known}
    for name in sorted(names | {name.partition("/")[0] for name in names}):
        below = f"{name}/"
        yield name, [(m, r) for m, r in known if m.module == name or m.module.startswith(below)]


def _interval(killed: int, of: int) -> str:
    """Return the exact 95 % interval of a share."""
    from scipy.stats import binomtest

    interval = binomtest(killed, of).proportion_ci(0.95, method="exact")
    return f"  (95 %: {100 * interval.low:.1f} to {100 * interval.high:.1f} %)"


if __name__ == "__main__":
    sys.exit(main())

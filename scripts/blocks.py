"""Check every command and every block of Python in README and docs.

python scripts/blocks.py              # names, options and reasons
python scripts/blocks.py --run        # and run what can be run, on a run of the demonstration

Every block of ```sh or ```python is run, here or by a step of .ci/run, or a comment before or after
it says why not::

    <!-- not run: needs the published data -->

Blocks that are not run are checked too: Python has to compile, and what it imports of graspcast has
to be there; a ``graspcast VERB`` has to exist, with every option that is given.

With ``--run``, blocks marked ``<!-- run -->`` are run in order, those of a page in one directory
that also holds ``graspcast-demo``: what GRASPCAST_DEMO names, or else a demonstration run now.
``<!-- run: goes on -->`` runs Python after the Python before it, ``<!-- run beside: URL -->`` a
server until the page ends, once URL answers; ``<!-- file: NAME -->`` writes a block to a file.
Two pages at a time are run.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)
_MARK = re.compile(
    r"<!--\s*(run beside|run by|run|not run|file)(?:: ((?:(?!-->).)*?))?\s*-->", re.S
)
_CHECKED = ("sh", "python")
_COMMAND = re.compile(
    r"^(graspcast [a-z]|pip install|python -m graspcast|(import|from) graspcast)", re.M
)
GOES_ON = "goes on"
# The port that pages name, and where servers listen instead when their blocks are run.
_PORT = "8000"
_PATIENCE_S = 600

_NAMES = {"dense": ("gdrnpp", "mine"), "direct": ("epos", "theirs"), "keypoints": ("zebrapose",)}
_TABLES = range(21, 26)


@dataclass(frozen=True)
class Block:
    """A block of a page: its language, its text, and how it is marked (``run``, …) and why."""

    page: Path
    line: int
    language: str
    text: str
    mark: str | None
    why: str

    @property
    def where(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def pages() -> list[Path]:
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, text: str | None = None) -> Iterator[Block]:
    """Yield the blocks of a page; a mark is in the line before a block, or in that after it."""
    text = page.read_text("utf-8") if text is None else text
    for found in _BLOCK.finditer(text):
        before = text[: found.start()].rstrip("\n").rpartition("\n\n")[2]
        after = text[found.end() :].lstrip("\n").partition("\n\n")[0]
        mark = _MARK.fullmatch(before.strip()) or _MARK.fullmatch(after.strip())
        if mark is None and (last := before.rpartition("\n")[2]):
            mark = _MARK.fullmatch(last.strip())
        line = text.count("\n", 0, found.start()) + 1
        kind, why = (mark[1], mark[2] or "") if mark else (None, "")
        if found[1] not in _CHECKED and kind is None and not _COMMAND.search(found[2]):
            continue  # what a program prints, or a file's content
        yield Block(page, line, found[1], found[2], kind, " ".join(why.split()))


def problems(block: Block) -> list[str]:
    """Return what is wrong with a block, without running it."""
    out = []
    if block.language not in _CHECKED and block.mark != "file":
        out.append("holds commands, so it has to be ```sh or ```python")
    elif block.mark is None:
        out.append("is neither run nor marked with the reason why not")
    elif block.mark == "run" and block.why not in ("", GOES_ON):
        out.append(f"run: {block.why}: is none of this script's marks")
    elif block.mark != "run" and not block.why:
        out.append(f"{block.mark}: says not what")
    elif block.mark == "run by" and not (ROOT / block.why.split()[0]).is_file():
        out.append(f"run by {block.why}: there is no such file")
    check = _wrong_python if block.language == "python" else _wrong_commands
    checked = [] if block.mark == "file" else check(block.text)
    return [f"{block.where}: {text}" for text in [*out, *checked]]


def _wrong_python(text: str) -> list[str]:
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        return [f"line {error.lineno} of the block: {error.msg}"]
    out = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "graspcast":
            out += _missing(node.module or "", [name.name for name in node.names])
        elif isinstance(node, ast.Import):
            for name in node.names:
                if name.name.split(".")[0] == "graspcast":
                    out += _missing(name.name, [])
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "graspcast":
            out += _missing("graspcast", [node.attr])
    return out


def _missing(module: str, names: list[str]) -> list[str]:
    try:
        found = import_module(module)
    except ImportError as error:
        return [str(error)]
    return [f"{module} has no {name}" for name in names if not hasattr(found, name)]


@cache
def _options() -> dict[str, set[str]]:
    """Return the options of each verb."""
    from graspcast.cli import parser, verb_parsers

    return {
        name: {option for action in verb._actions for option in action.option_strings}
        for name, verb in verb_parsers(parser()).items()
    }


def _wrong_commands(text: str) -> list[str]:
    out = []
    joined = re.sub(r"\\\n", " ", text)
    joined = re.sub(r"'[^']*'|\"[^\"]*\"|(?<!\S)#.*", "TEXT", joined)
    for command in re.findall(r"\bgraspcast ([^\n|;&]*)", joined):
        words = command.split()
        if not words or words[0] in ("TEXT", "--version", "--help", "-h"):
            continue
        if words[0] not in _options():
            out.append(f"graspcast has no verb {words[0]}")
            continue
        known = _options()[words[0]]
        given = [word.partition("=")[0] for word in words if word.startswith("--")]
        out += [f"graspcast {words[0]} has no {option}" for option in given if option not in known]
    return out


def _command(block: Block, before: str) -> list[str]:
    """Return the command that runs a block; ``before`` is the Python on which it goes on."""
    if block.language == "python":
        return [sys.executable, "-c", before + block.text]
    serve = (
        'graspcast() { [ "$1" != serve ] || set -- "$@" --port "$PORT"; command graspcast "$@"; }'
    )
    return ["bash", "-euo", "pipefail", "-c", f"{serve}\n{block.text}"]


def run(block: Block, here: Path, environment: Mapping[str, str], before: str = "") -> str | None:
    """Run a block in a directory; return what it printed if it failed."""
    command = _command(block, before)
    try:
        done = subprocess.run(
            command, cwd=here, env=environment, capture_output=True, text=True, timeout=_PATIENCE_S
        )
    except subprocess.TimeoutExpired:
        return f"took more than {_PATIENCE_S} s"
    return None if done.returncode == 0 else f"{done.stdout}{done.stderr}"[-2000:]


def run_beside(
    block: Block, here: Path, environment: Mapping[str, str], until: ExitStack
) -> str | None:
    """Start a server, stopped with ``until``; return what it printed if it does not answer."""
    said = here / "server.txt"
    with said.open("w") as out:
        server = subprocess.Popen(
            _command(block, ""),
            cwd=here,
            env=environment,
            stdout=out,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    until.callback(server.wait)
    until.callback(_stop, server.pid)
    url = block.why.replace(_PORT, environment["PORT"])
    patience = time.monotonic() + 120
    while server.poll() is None and time.monotonic() < patience:
        with suppress(OSError), urllib.request.urlopen(url, timeout=10):
            return None
        time.sleep(0.2)
    return said.read_text()[-2000:] or f"{url} does not answer"


def _stop(group: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGTERM)


def _free_port() -> str:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return str(taken.getsockname()[1])


def furnish(here: Path, demo: Path) -> None:
    """Fill a directory with the files that pages name, made from a run of the demonstration.

    The estimators have the names of pages as well as their own: the principal is ``gdrnpp``. Files
    under those names are of five of the tables that the demonstration's model has not seen.
    """
    import polars as pl

    from graspcast import demo_dataset, read_camera_motion, read_outcomes

    data = demo_dataset().root
    shutil.copytree(demo, here / "graspcast-demo")
    shutil.copytree(demo / "trials", here / "trials")
    shutil.copytree(data, here / "ycbv")
    for name, others in _NAMES.items():
        table = pl.read_csv(demo / f"{name}_ycbv-test.csv", infer_schema=False)
        table.write_csv(here / f"{name}_ycbv-test.csv")
        for other in others:
            unseen = table.filter(pl.col("scene_id").cast(int).is_in(_TABLES))
            unseen.write_csv(here / f"{other}_ycbv-test.csv")
    shutil.copy(demo / "model.npz", here)
    verdicts = pl.read_csv(demo / "verdicts1.csv", infer_schema=False)
    verdicts.filter(pl.col("principal") == "dense").write_csv(here / "verdicts.csv")
    read_outcomes(demo / "trials").filter(pl.col("scene_id").is_in(_TABLES)).with_columns(
        pl.col("estimator").replace({name: others[0] for name, others in _NAMES.items()})
    ).write_csv(here / "trials.csv")
    poses = read_camera_motion(data / "test").world_T_cam
    lines = [f"{s},{i},{' '.join(map(str, pose.ravel()))}" for (s, i), pose in poses.items()]
    (here / "cameras.csv").write_text("\n".join(["scene_id,im_id,world_T_cam_m", *lines, ""]))
    _write_meshes(here / "meshes")
    # What FoundationPose writes of each image: a matrix, metres.
    (here / "debug" / "ob_in_cam").mkdir(parents=True)
    for i in range(3):
        text = f"1 0 0 0.0{i}\n0 1 0 0\n0 0 1 0.7\n0 0 0 1\n"
        (here / "debug" / "ob_in_cam" / f"{i:06d}.txt").write_text(text)
    mug = [sys.executable, str(ROOT / ".ci" / "mug.py"), str(here / "mug.stl")]
    subprocess.run(mug, check=True)


def _write_meshes(folder: Path) -> None:
    """Write a folder of meshes, and a table of their masses beside it."""
    from trimesh.creation import box, cylinder

    folder.mkdir()
    box((40, 60, 100)).export(folder / "box.stl")
    cylinder(20, 80).export(folder / "can.stl")
    (folder.parent / "masses.csv").write_text("object,mass_kg\nbox,0.2\ncan,0.15\n")


def run_all(found: list[Block], demo: Path, scratch: Path) -> list[str]:
    """Run the blocks that are marked so; return those that failed, with their output."""
    from graspcast import demo_dataset

    paths = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    mine = {"PATH": paths, "DATA": str(demo_dataset().root), "PORT": _free_port()}
    furnished = scratch / "furnished"
    furnished.mkdir()
    furnish(furnished, demo)

    def of_page(page: Path) -> list[str]:
        here = shutil.copytree(furnished, scratch / page.stem)
        those = [block for block in found if block.page == page]
        with ExitStack() as until:
            return _run_page(those, here, {**os.environ, **mine}, until)

    with ThreadPoolExecutor(2) as pool:
        wrong = pool.map(of_page, dict.fromkeys(block.page for block in found))
        return [text for those in wrong for text in those]


def _run_page(
    found: list[Block], here: Path, environment: Mapping[str, str], until: ExitStack
) -> list[str]:
    """Run the blocks of a page in a directory; return those that failed, with their output."""
    wrong, before = [], ""
    for block in found:
        text = block.text.replace(f"127.0.0.1:{_PORT}", f"127.0.0.1:{environment['PORT']}")
        block = replace(block, text=text)
        began = time.monotonic()
        if block.mark == "file":
            (here / block.why).write_text(block.text, encoding="utf-8")
            continue
        if block.mark == "run beside":
            said = run_beside(block, here, environment, until)
        else:
            before = before if block.why == GOES_ON else ""
            said = run(block, here, environment, before)
        if block.language == "python":
            before += block.text
        state = "done" if said is None else "failed"
        print(f"{block.where}: {state}, {time.monotonic() - began:.1f} s", flush=True)
        if said is not None:
            wrong.append(f"{block.where}: failed\n{said}")
    return wrong


def main() -> int:
    parser = ArgumentParser(description="Check every block of commands and Python in the docs.")
    parser.add_argument("--run", action="store_true", help="also run what is marked so")
    options = parser.parse_args()
    found = [block for page in pages() for block in blocks(page)]
    wrong = [text for block in found for text in problems(block)]
    runs = [block for block in found if block.mark in ("run", "run beside", "file")]
    if options.run:
        with TemporaryDirectory() as scratch:
            demo = Path(
                os.environ.get("GRASPCAST_DEMO") or Path(scratch) / "demo" / "graspcast-demo"
            )
            if not (demo / "model.npz").is_file():
                demo.parent.mkdir()
                command = [sys.executable, "-m", "graspcast", "demo", "--out", str(demo)]
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            wrong += run_all(runs, demo, Path(scratch))
    print("\n".join(wrong))
    count = Counter(block.mark for block in found)
    here = count["run"] + count["run beside"]
    print(
        f"{here} blocks run here, {count['run by']} run by others, {count['not run']} not run",
        end="",
    )
    print(f"; {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

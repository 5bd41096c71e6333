"""Where tests find the published data, and what happens where there is none."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings
from hypothesis.configuration import set_hypothesis_home_dir

from graspcast.paper.dataset import Published

# Beside what pytest keeps, not in the current folder, and not in the user's own cache.
_KEPT = Path(__file__).parents[1] / ".pytest_cache"
set_hypothesis_home_dir(_KEPT / "hypothesis")
os.environ.setdefault("GRASPCAST_CACHE", str(_KEPT / "graspcast"))
# Imports and shared machines take their time; no test is about how long it takes.
# The same examples every time, so that a change that fails is the one that broke something.
settings.register_profile("slow", deadline=None, derandomize=True, database=None)
settings.register_profile("fast", settings.get_profile("slow"), max_examples=25)

# Files of slow tests alone, whose collection takes longer than a second.
_SLOW_FILES = {"test_schema_fuzz.py"}


def pytest_configure(config: pytest.Config) -> None:
    """Let forecasters be trained on few data; pyproject.toml cannot name the category.

    To resolve it imports graspcast, before run-time types could be added.
    """
    settings.load_profile("fast" if without_slow(config) else "slow")
    config.addinivalue_line("filterwarnings", "ignore::graspcast.errors.TrainingDataWarning")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the slow tests, too")
    parser.addoption(
        "--slow-part",
        type=_part,
        metavar="K/N",
        help="run the slow tests of every N-th file too, K of 1 to N",
    )


def _part(text: str) -> tuple[int, int]:
    """Parse ``K/N``."""
    which, _, of = text.partition("/")
    if not (which.isdecimal() and of.isdecimal() and 1 <= int(which) <= int(of)):
        raise argparse.ArgumentTypeError(f"{text!r} is not K/N with K from 1 to N, such as 2/3")
    return int(which), int(of)


def without_slow(config: pytest.Config) -> bool:
    """Whether slow tests are left out: nobody asked for them, by option, mark or name."""
    named = any("::" in argument for argument in config.args)
    asked = config.getoption("slow") or config.getoption("slow_part")
    return not (asked or "slow" in config.getoption("markexpr") or named)


def _of_other_parts(config: pytest.Config, slow: list[pytest.Item]) -> set[pytest.Item]:
    """Return the slow tests of files that are not in the wanted part."""
    if config.getoption("slow") or not config.getoption("slow_part"):
        return set()
    which, of = config.getoption("slow_part")
    files = sorted({item.path for item in slow})
    mine = set(files[which - 1 :: of])
    return {item for item in slow if item.path not in mine}


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    return (collection_path.name in _SLOW_FILES and without_slow(config)) or None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out slow tests, or begin with the files that hold most of them.

    So that no process works on its last long file when the others are done.
    """
    slow = [item for item in items if item.get_closest_marker("slow")]
    left_out = set(slow) if without_slow(config) else _of_other_parts(config, slow)
    if left_out:
        config.hook.pytest_deselected(items=list(left_out))
        items[:] = [item for item in items if item not in left_out]
    if hasattr(config, "workerinput"):
        slow_tests, tests = (Counter(item.path for item in of) for of in (slow, items))
        items.sort(key=lambda item: (-slow_tests[item.path], -tests[item.path]))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if without_slow(config):
        terminalreporter.write_line("slow tests were left out: pytest --slow runs them, too")
    elif part := config.getoption("slow_part"):
        terminalreporter.write_line(f"slow tests: part {part[0]} of {part[1]} of their files")


@pytest.fixture(autouse=True)
def _run_time_types(request: pytest.FixtureRequest) -> Iterator[None]:
    """Under ``--jaxtyping-packages`` annotations hold, but where a test breaks them on purpose."""
    on_purpose = request.node.get_closest_marker("ill_typed") is not None
    jaxtyping.config.update("jaxtyping_disable", on_purpose)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The published data; a test that asks for it is skipped where it is absent."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    directory = Path(os.environ.get("GRASPCAST_DATA") or beside)
    if not (directory / "published").is_dir():
        pytest.skip(
            f"the published data is not at {directory}: set GRASPCAST_DATA to a directory "
            "that holds published/, raw/ and bop/"
        )
    return directory


@pytest.fixture(scope="session")
def published(data_dir: Path) -> Path:
    return data_dir / "published"


@pytest.fixture(scope="session")
def data(data_dir: Path) -> Published:
    """The published data, read once a session."""
    return Published(data_dir)

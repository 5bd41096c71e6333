"""Files of a release: one version everywhere, and the licence of everything that is bundled."""

from __future__ import annotations

import re
import sys
import tarfile
import tomllib
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from io import BytesIO
from pathlib import Path
from types import ModuleType

import pytest

from graspcast._version import __version__

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "graspcast"


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def _scripts_find_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")


def script(name: str) -> ModuleType:
    spec = spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_citation_is_of_this_version() -> None:
    assert f"\nversion: {__version__}\n" in text_of("CITATION.cff")


def test_the_packages_for_ros_are_of_this_version() -> None:
    for path in [*ROOT.glob("ros/*/package.xml"), *ROOT.glob("ros/*/setup.py")]:
        stated = re.findall(
            r"<version>(.+)</version>|^    version=\"(.+)\"", path.read_text("utf-8"), re.M
        )
        assert ["".join(found) for found in stated] == [__version__], path


def test_the_same_authors_are_named_everywhere() -> None:
    (author,) = tomllib.loads(text_of("pyproject.toml"))["project"]["authors"]
    assert f"  - name: {author['name']}\n" in text_of("CITATION.cff")
    for path in [*ROOT.glob("ros/*/package.xml"), *ROOT.glob("ros/*/setup.py")]:
        text = path.read_text("utf-8")
        assert f">{author['name']}</maintainer>" in text or f'maintainer="{author["name"]}"' in text


def test_the_changelog_has_this_version_and_what_is_not_released() -> None:
    sections = set(re.findall(r"^## \[(.+)\]", text_of("CHANGELOG.md"), re.M))
    assert {"Unreleased", __version__} <= sections


def test_no_file_of_the_package_but_code_lacks_a_notice() -> None:
    named = re.findall(r": (graspcast/\S+)", text_of("NOTICE"))
    assert all((ROOT / "src" / name).exists() for name in named)
    for path in PACKAGE.rglob("*"):
        if path.is_dir() or path.suffix == ".py" or path.parent.name == "__pycache__":
            continue
        name = path.relative_to(ROOT / "src").as_posix()
        ours = path.name in ("py.typed", "README.md") or "report/templates/" in name
        assert ours or any(name.startswith(folder) for folder in named), name


def test_every_script_that_is_named_exists() -> None:
    files = [*(ROOT / ".github").rglob("*.yml"), ROOT / "CONTRIBUTING.md", ROOT / ".ci" / "run"]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    named = set(re.findall(r"(?:scripts|\.ci)/\w+(?:\.py)?", text))
    assert len(named) > 4
    for name in named:
        assert (ROOT / name).is_file(), name


def test_the_tests_of_dependency_bounds_exist() -> None:
    for name in script("dependency_bounds").TESTS:
        assert (ROOT / "tests" / name).exists(), name


def test_programs_are_found_beside_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert Path(script("environments").program("pytest")).parent == Path(sys.executable).parent
    with pytest.raises(SystemExit, match="nothing-like-it is not installed"):
        script("environments").program("nothing-like-it")


def test_the_oldest_mujoco_is_the_declared_one() -> None:
    from graspcast.simulation.mujoco_version import OLDEST

    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    assert f"mujoco>={'.'.join(map(str, OLDEST))}" in project["dependencies"]


def wheel(folder: Path, *more: str) -> Path:
    path = folder / "graspcast-0-py3-none-any.whl"
    needed = ["LICENSE", "NOTICE", "LICENSES/CC-BY-4.0.txt"]
    with zipfile.ZipFile(path, "w") as archive:
        for name in needed:
            archive.writestr(f"graspcast-0.dist-info/licenses/{name}", "")
        archive.writestr("graspcast/demo_data/ycbv/models/obj_000002.ply", "")
        for name in more:
            archive.writestr(name, "")
    return path


def test_a_wheel_of_code_licences_and_the_demonstration_is_right(tmp_path: Path) -> None:
    assert script("build").contents_problems(wheel(tmp_path, "graspcast/__init__.py")) == []


@pytest.mark.parametrize("name", ["tests/data/a.csv", "graspcast/data.csv", "graspcast/a.pyc"])
def test_a_wheel_with_anything_else_is_not(name: str, tmp_path: Path) -> None:
    problems = script("build").contents_problems(wheel(tmp_path, name))
    assert any(f"{name} does not belong in it" in problem for problem in problems)


def test_an_sdist_without_licences_or_with_tests_is_not_right(tmp_path: Path) -> None:
    path = tmp_path / "graspcast-0.tar.gz"
    with tarfile.open(path, "w:gz") as archive:
        for name in ("graspcast-0/src/graspcast/a.py", "graspcast-0/tests/data/a.csv"):
            archive.addfile(tarfile.TarInfo(name), BytesIO())
    problems = "\n".join(script("build").contents_problems(path))
    assert "tests/data/a.csv does not belong in it" in problems
    assert "NOTICE is missing" in problems


def test_what_does_not_work_on_a_package_page_is_found() -> None:
    problems = script("build").page_problems
    right = "pip install graspcast && graspcast demo\n[BOP](https://bop.felk.cvut.cz/)"
    assert problems(right) == []
    wrong = "pip install -e . && graspcast demo\n![a](docs/a.png) [b](docs/b.md#c)"
    said = "\n".join(problems(wrong))
    for part in ("docs/a.png leads", "docs/b.md#c leads", "needs a checkout", "does not say how"):
        assert part in said


def test_a_release_is_refused_without_a_changelog(monkeypatch: pytest.MonkeyPatch) -> None:
    release = script("release")
    monkeypatch.setattr(release, "_output", lambda *command: "")
    release.check_state()
    monkeypatch.setattr(release, "version", lambda: "99.0")
    with pytest.raises(SystemExit, match=r"CHANGELOG.md has no section \[99.0\]"):
        release.check_state()
    monkeypatch.setattr(release, "_output", lambda *command: " M README.md")
    with pytest.raises(SystemExit, match="not committed"):
        release.check_state()


def test_a_tag_of_this_version_has_to_be_of_this_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    release = script("release")
    said = {"status": "", "tag": "abc", "rev-parse": "abc"}
    monkeypatch.setattr(release, "_output", lambda *command: said[command[1]])
    release.check_state()
    said["tag"] = "def"
    with pytest.raises(SystemExit, match="is the tag of another commit"):
        release.check_state()


def test_what_was_not_tested_is_called_no_release(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    release = script("release")
    ran = []
    monkeypatch.setattr(release, "check_state", lambda: None)
    monkeypatch.setattr(release, "_run", lambda *command, **_: ran.append(str(command[1])))
    command = ["release.py", "--out", str(tmp_path), "--without", "uvx", "sbom", "checksums"]
    monkeypatch.setattr(sys, "argv", [*command, "--skip-tests"])
    release.main()
    out = capsys.readouterr().out
    assert out.startswith("NOT A RELEASE: left out are tests, lowest, newest, uvx")
    assert "Do not upload" in out and "twine upload" not in out
    assert [Path(name).name for name in ran] == ["lint.py", "build.py", "try_wheel.py"]
    (tmp_path / "old.whl").touch()
    with pytest.raises(SystemExit, match="is not empty"):
        release.main()


def test_no_file_names_this_machine() -> None:
    for name in ("NOTICE", "CITATION.cff", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"):
        assert str(ROOT) not in text_of(name)
        assert sys.prefix not in text_of(name)

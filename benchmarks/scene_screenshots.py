"""Screenshots of `graspcast view` for docs/viewing.md: a scene and a trial, in headless Chromium.

    graspcast demo --out graspcast-demo
    python benchmarks/scene_screenshots.py graspcast-demo docs/figures

It needs the extra view, Playwright and Chromium (--chromium), which draws in software.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from graspcast.demo_data import demo_dataset

_SIZE = {"width": 1100, "height": 640}
_SWITCHES = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_DRAWN_MS = 8000


@contextmanager
def viewed(*options: str) -> Iterator[str]:
    """Run the verb view, and yield its address."""
    command = [sys.executable, "-m", "graspcast", "view", *options, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield next(line.split()[-1] for line in process.stdout if "http://" in line)
        finally:
            process.terminate()


def take(
    browser: Any, url: str, path: Path, *, hide: Sequence[str] = (), play_s: float = 0
) -> None:
    """Take a screenshot, with some groups hidden and a trial played up to a time."""
    page = browser.new_page(viewport=_SIZE)
    page.set_default_timeout(180_000)
    page.goto(url)
    page.get_by_text("Metres.").wait_for()
    page.wait_for_timeout(_DRAWN_MS)
    for group in hide:
        page.get_by_label(group, exact=True).click()
    if play_s:
        slider = page.locator("input[type=text]:not([disabled]), input[inputmode]").first
        slider.fill(str(play_s))
        slider.press("Enter")
    notice = page.locator(".mantine-Notification-closeButton")
    if notice.count():
        notice.first.click()
    page.wait_for_timeout(_DRAWN_MS)
    page.screenshot(path=path)
    page.close()
    print(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="what graspcast demo wrote")
    parser.add_argument("out", type=Path, help="directory of the pictures")
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    dataset, demo = demo_dataset(), options.demo
    bop = ["--bop", str(dataset.root)]
    estimates = [
        text
        for name in ("dense", "direct", "keypoints")
        for text in ("--estimates", f"{name}={demo / f'{name}_ycbv-test.csv'}")
    ]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        fused, table = Path(folder) / "fused_ycbv-test.csv", Path(folder) / "covariances.csv"
        fuse = [*bop, *estimates, "--camera-poses", str(dataset.scenes), "--views-from", "all"]
        fuse += ["--scenes", "21", "--out", str(fused), "--covariances", str(table)]
        subprocess.run([sys.executable, "-m", "graspcast", "fuse", *fuse], check=True)
        browser = play.chromium.launch(executable_path=options.chromium, args=_SWITCHES)
        scene = [*bop, *estimates[:4], "--image", "21/1", "--fused", str(fused)]
        scene += ["--covariances", str(table), "--verdicts", str(demo / "verdicts3.csv")]
        scene += ["--objects", "2", "9", "12", "--ellipsoid-sd", "10"]
        with viewed(*scene) as url:
            take(browser, url, options.out / "view-scene.png", hide=["truth"])
        trial = ["--object", "ycbv-3", "--gripper", "underactuated"]
        with viewed(*trial, "--offset", *["6", "4", "0", "0", "4", "0"]) as url:
            take(browser, url, options.out / "view-trial.png", play_s=2.4)
        browser.close()


if __name__ == "__main__":
    main()

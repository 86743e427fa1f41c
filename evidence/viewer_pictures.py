"""Draw the pictures of the viewer in the guide: the packaged lane, and two scores side by side.

Needs Playwright and Chromium, as the tests do. Usage::

    python evidence/viewer_pictures.py [-o docs/images]
"""

from __future__ import annotations

import argparse
import io
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from flgpr.commands.demo import demo
from flgpr.commands.score import score
from flgpr.viewer import Viewer

SIZE = (1400, 860)
COLOURS = 256
LANE = "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 200.0\n"
MINES = 24
FALSE = 80
VENDORS = {"vendor-a": (1.0, 1.2), "vendor-b": (0.5, 0.9)}  # how far mines stand out, metal more by


@contextmanager
def shown(page: Page, *what: Path) -> Iterator[None]:
    """Show results or scores on a page while the block lasts."""
    viewer = Viewer(list(what))
    server = threading.Thread(target=viewer.run)
    server.start()
    try:
        page.goto(viewer.url)
        page.wait_for_selector("#counts tr")
        yield
    finally:
        page.goto("about:blank")
        viewer.stop()
        server.join()


def invented_scores(home: Path) -> list[Path]:
    """Score the invented lists of two detectors on an invented lane."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-1.5, 1.5, MINES), 4.0 + 8.0 * np.arange(MINES)
    is_metal = np.arange(MINES) % 2 == 0
    truth = pd.DataFrame(
        {
            "target_id": [f"T{number + 1:02}" for number in range(MINES)],
            "kind": np.where(is_metal, "metal", "plastic"),
            "x": x,
            "y": y,
            "depth": np.resize([0.02, 0.05, 0.10], MINES),
        }
    )
    truth.to_csv(home / "truth.csv", index=False)
    (home / "lane.toml").write_text(LANE)
    scores = []
    for name, (level, metal) in VENDORS.items():
        at_mines = rng.normal(level + metal * is_metal, 0.7)
        elsewhere = rng.normal(0.0, 0.7, FALSE)
        alarms = pd.DataFrame(
            {
                "x": np.concatenate([x + 0.1, rng.uniform(-2.0, 2.0, FALSE)]),
                "y": np.concatenate([y, rng.uniform(0.0, 200.0, FALSE)]),
                "confidence": np.concatenate([at_mines, elsewhere]),
            }
        )
        alarms.to_csv(home / f"{name}.csv", index=False)
        scores.append(home / name)
        score(home / f"{name}.csv", home / "truth.csv", lane=home / "lane.toml", output=scores[-1])
    return scores


def write_picture(page: Page, path: Path) -> None:
    """Write what a page shows, in so many colours."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    # The colours that are rare, as that of what is missed, stay what they are.
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    """Draw the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    images = Path(__file__).parent.parent / "docs" / "images"
    parser.add_argument("-o", "--output", type=Path, default=images)
    output = parser.parse_args().output
    browser_path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        home = Path(folder)
        demo(home / "demo-result")
        scores = invented_scores(home)
        browser = playwright.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        with shown(page, home / "demo-result"):
            for _ in range(3):
                page.keyboard.press("n")  # to the third alarm, a hit
            page.wait_for_selector("#patches canvas")
            page.wait_for_timeout(1000)
            write_picture(page, output / "viewer.png")
        with shown(page, *scores):
            page.wait_for_timeout(1000)
            write_picture(page, output / "viewer-scores.png")
        browser.close()


if __name__ == "__main__":
    main()

"""Draw the animated picture of `flgpr demo --live` that the README begins with.

The packaged drive is shown on the driver's screen in a browser without windows, whose clock goes only when it is told
to: a slow machine makes the same picture as a quick one. Needs Playwright and Chromium, as the tests do. Usage::

    python evidence/demo_picture.py [-o docs/images/demo-live.gif]
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import tempfile
import threading
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from flgpr.live.events import EVENT_FILE, EventFile
from flgpr.live.recording import read_recording
from flgpr.store import sample_drive
from flgpr.viewer import Viewer

RATE = 4.2  # scans/s
FIRST, LAST = 24, 92  # scans that are shown
EVERY = 2  # scans per picture
SCREEN = (1024, 768)
WIDTH = 640  # of the picture
COLOURS = 64
AHEAD = 1000.0  # s, by which arrivals lie in the future: the page then goes by the recorded latency
CLOCK = """(() => {
    const later = window.setTimeout.bind(window), timers = new Map();
    let now = performance.now(), last = 0;
    performance.now = () => now;
    window.setTimeout = (act, wait = 0) => timers.set(++last, { act, at: now + wait }) && last;
    window.clearTimeout = (timer) => timers.delete(timer);
    window.pass = async (milliseconds) => {
        const end = now + milliseconds;
        for (;;) {
            await new Promise((done) => later(done, 40));  // answers of the server come in
            const due = [...timers].filter(([, one]) => one.at <= end);
            if (!due.length) break;
            const [key, next] = due.sort(([, a], [, b]) => a.at - b.at)[0];
            timers.delete(key);
            now = Math.max(now, next.at);
            next.act();
        }
        now = end;
    };
})()"""


def pictures(page: Page, folder: Path) -> list[Image.Image]:
    """Return the driver's screen after every other scan of the part that is shown."""
    before, scans, _ = read_recording(sample_drive() / "drive.jsonl.gz")
    begin = time.time() + AHEAD
    frames = []
    with EventFile(folder / EVENT_FILE, fresh=True) as file:
        file.append(before)
        for number, scan in enumerate(scans[: LAST + 1]):
            for event in scan.events:
                if event["event"] == "scan":
                    event["arrived"] = round(begin + number / RATE, 3)
            file.append(scan.events)
            # A sign of life from the future stays fresh however long the browser takes.
            os.utime(folder / EVENT_FILE, (begin, begin))
            page.evaluate("(time) => pass(time)", 1e3 / RATE)
            if number >= FIRST and (number - FIRST) % EVERY == 0:
                frames.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    return frames


def write_animation(frames: list[Image.Image], path: Path) -> None:
    """Write pictures as a GIF at the pace of the drive, with one palette for all."""
    height = WIDTH * SCREEN[1] // SCREEN[0]
    small = [frame.resize((WIDTH, height), Image.Resampling.LANCZOS) for frame in frames]
    sheet = Image.new("RGB", (WIDTH, height * 3))
    for row, frame in enumerate((small[0], small[len(small) // 2], small[-1])):
        sheet.paste(frame, (0, row * height))
    palette = sheet.quantize(COLOURS)
    drawn = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in small]
    pause = round(1e3 * EVERY / RATE)
    drawn[0].save(
        path, save_all=True, append_images=drawn[1:], duration=pause, loop=0, optimize=True
    )


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    images = Path(__file__).parent.parent / "docs" / "images"
    parser.add_argument("-o", "--output", type=Path, default=images / "demo-live.gif")
    output = parser.parse_args().output
    browser_path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        viewer = Viewer([], live=folder)
        server = threading.Thread(target=viewer.run)
        server.start()
        browser = playwright.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            page = browser.new_page(viewport={"width": SCREEN[0], "height": SCREEN[1]})
            page.add_init_script(CLOCK)
            page.goto(viewer.url)
            frames = pictures(page, Path(folder))
        finally:
            browser.close()
            viewer.stop()
            server.join()
    write_animation(frames, output)
    print(f"{output}: {len(frames)} pictures, {output.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()

"""Draw the animated picture of `flgpr demo --live` that the README begins with, or the driver's screen with its words.

The packaged drive is shown on the driver's screen in a browser without windows, whose clock goes only when it is told
to: a slow machine makes the same picture as a quick one. Needs Playwright and Chromium, as the tests do. Usage::

    python evidence/demo_picture.py [-o docs/images/demo-live.gif]
    python evidence/demo_picture.py --screens [-o docs/images/live-drive.png]
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from flgpr.live.events import EVENT_FILE, EventFile
from flgpr.live.recording import read_recording
from flgpr.store import sample_drive
from flgpr.viewer import Viewer

RATE = 2.25  # scans/s, as the demo plays it
FIRST, LAST = 12, 80  # scans that are shown
EVERY = 2  # scans per picture
SCREEN = (1024, 768)
WIDTH = 640  # of the picture
COLOURS = 64
WORDS = ("slow", "brake", "over")  # that are shown by day, at night and in the sun
SILENCE = 1.2  # s without the radar, in the last picture
AHEAD = 1000.0  # s, by which arrivals lie in the future: the page then goes by the recorded latency
CLOCK = """(() => {
    const later = window.setTimeout.bind(window), ask = window.fetch.bind(window), timers = new Map();
    let now = performance.now(), last = 0, waiting = 0;
    performance.now = () => now;
    window.setTimeout = (act, wait = 0) => timers.set(++last, { act, at: now + wait }) && last;
    window.clearTimeout = (timer) => timers.delete(timer);
    window.fetch = async (...what) => {
        waiting++;
        try {
            const answer = await ask(...what), text = await answer.text();
            answer.json = async () => JSON.parse(text);
            return answer;
        } finally { waiting--; }
    };
    window.pass = async (milliseconds) => {
        const end = now + milliseconds;
        for (;;) {
            do await new Promise((done) => later(done)); while (waiting);  // answers of the server come in
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


class Drive:
    """The packaged drive, which arrives scan by scan on a page.

    Parameters
    ----------
    page : Page
        The driver's screen, whose clock goes only when it is told to.
    folder : Path
        Folder of the live run that the page shows.
    """

    def __init__(self, page: Page, folder: Path) -> None:
        self.page = page
        self.path = folder / EVENT_FILE
        self.begin = time.time() + AHEAD

    def play(self, last: int, shown: Callable[[int], None]) -> None:
        """Let the scans up to the last arrive, and call a function with the number of each."""
        before, scans, _ = read_recording(sample_drive() / "drive.jsonl.gz")
        with EventFile(self.path, fresh=True) as file:
            file.append(before)
            for number, scan in enumerate(scans[: last + 1]):
                for event in scan.events:
                    if event["event"] == "scan":
                        event["arrived"] = round(self.begin + number / RATE, 3)
                file.append(scan.events)
                # A sign of life from the future stays fresh however long the browser takes.
                os.utime(self.path, (self.begin, self.begin))
                self.page.evaluate("(time) => pass(time)", 1e3 / RATE)
                shown(number)

    def fall_silent(self, seconds: float) -> None:
        """Let no scan arrive for a time, while detection goes on."""
        os.utime(self.path, (self.begin, self.begin))
        self.page.evaluate("(time) => pass(time)", 1e3 * seconds)

    def word(self) -> str:
        """Return what the driver is told."""
        return str(self.page.get_attribute("#drive", "data-word"))

    def picture(self) -> Image.Image:
        """Return what the page shows."""
        return Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")


def pictures(drive: Drive) -> list[Image.Image]:
    """Return the driver's screen after every other scan of the part that is shown."""
    frames: list[Image.Image] = []

    def shown(number: int) -> None:
        if number >= FIRST and (number - FIRST) % EVERY == 0:
            frames.append(drive.picture())

    drive.play(LAST, shown)
    return frames


def screens(drive: Drive) -> list[Image.Image]:
    """Return the driver's screen with each of three words in its theme, and when the radar falls silent."""
    frames: list[Image.Image] = []

    def shown(number: int) -> None:
        if number < FIRST or len(frames) == len(WORDS) or drive.word() != WORDS[len(frames)]:
            return
        frames.append(drive.picture())
        drive.page.click("#drive-theme")  # to the next one of the three themes

    drive.play(LAST, shown)
    drive.fall_silent(SILENCE)
    frames.append(drive.picture())
    return frames


def write_screens(frames: list[Image.Image], path: Path) -> None:
    """Write four pictures as one, two in a row."""
    height = WIDTH * SCREEN[1] // SCREEN[0]
    sheet = Image.new("RGB", (2 * WIDTH, 2 * height))
    for number, frame in enumerate(frames):
        small = frame.resize((WIDTH, height), Image.Resampling.LANCZOS)
        sheet.paste(small, (number % 2 * WIDTH, number // 2 * height))
    sheet.save(path, optimize=True)


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
    parser.add_argument("--screens", action="store_true", help="the screen in its themes")
    parser.add_argument("-o", "--output", type=Path)
    given = parser.parse_args()
    output = given.output or images / ("live-drive.png" if given.screens else "demo-live.gif")
    browser_path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        viewer = Viewer([], live=folder)
        viewer.keep_answers()
        server = threading.Thread(target=viewer.run)
        server.start()
        browser = playwright.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            page = browser.new_page(viewport={"width": SCREEN[0], "height": SCREEN[1]})
            page.add_init_script(CLOCK)
            page.goto(viewer.url)
            drive = Drive(page, Path(folder))
            frames = screens(drive) if given.screens else pictures(drive)
        finally:
            browser.close()
            viewer.stop()
            server.join()
    if given.screens:
        write_screens(frames, output)
    else:
        write_animation(frames, output)
    print(f"{output}: {len(frames)} pictures, {output.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()

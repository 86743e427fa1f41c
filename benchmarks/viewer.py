"""Measure the viewer in headless Chromium: what a user waits for, and what the server needs.

The lane is that of the tests: 60 x 12,000 pixels (1.2 km), 900 alarms, 80 targets, two
polarizations and sub-bands before and after suppression. Usage::

    python benchmarks/viewer.py [--rounds 5]

Prints, per round, the time from the page's load to the first picture, the time for new colours, frames per second and
the time of a frame while the picture is dragged, how long after the event a live alarm stands on the page, and in the
end the peak memory of the server after it has sent every tile of two such results.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "viewer"))
from watching import DRAG, FLAGS

from long_lane import make_long_lane

FIRST = "performance.getEntriesByName('flgpr:first-picture')"


@contextmanager
def server(*arguments):
    """Run `flgpr view` in a process of its own; give its address and process."""
    command = [sys.executable, "-u", "-m", "flgpr", "view", *map(str, arguments), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            url = process.stdout.readline().strip()
            for _ in range(200):
                try:
                    urllib.request.urlopen(url).read()
                    break
                except OSError:
                    time.sleep(0.05)
            yield url, process
        finally:
            process.terminate()


def look(page, url):
    """Open a page and measure it."""
    page.goto(url)
    while not page.evaluate(f"{FIRST}.length"):
        page.wait_for_timeout(20)
    loaded = "performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd"
    first = page.evaluate(f"{FIRST}[0].startTime - {loaded}")
    for _ in range(6):
        page.keyboard.press("+")
    page.wait_for_timeout(500)
    page.evaluate("performance.clearMeasures('flgpr:frame')")
    times = page.evaluate(DRAG, 120)
    frames = page.evaluate("performance.getEntriesByName('flgpr:frame').map((e) => e.duration)")
    for name in ("magma", "cividis", "grey", "viridis"):
        page.select_option("#map", name)
    page.keyboard.press("f")
    for name in ("magma", "cividis", "grey", "viridis"):
        page.select_option("#map", name)
    colours = page.evaluate("performance.getEntriesByName('flgpr:recolour').map((e) => e.duration)")
    gaps = [b - a for a, b in itertools.pairwise(times)]
    return first, max(colours), 1000 / statistics.median(gaps), 1000 / max(gaps), max(frames)


def live_delay(page, folder):
    """Time from the writing of an alarm's event to its line on the page, ms."""
    file = folder / "live.jsonl"
    waits = []
    file.write_text(
        json.dumps({"event": "start", "lane": {"x_min": -3, "x_max": 3, "y_min": 0, "y_max": 60}})
        + "\n"
    )
    scan = {"event": "scan", "scan": 0, "pose": [0, 2, 5, 0, 0, 0]}
    with server("--live", folder) as (url, _):
        page.goto(url)
        page.click("#to-desk")  # the driver's screen comes first
        for number in range(12):
            name = f"alarm-{number}"
            alarm = {
                "event": "alarm",
                "alarm_id": name,
                "x": 1.0,
                "y": 5.0 - 0.1 * number,
                "confidence": 4.5,
            }
            start = time.perf_counter()
            with file.open("a") as out:
                out.write(json.dumps(scan) + "\n" + json.dumps(alarm) + "\n")
            page.locator("#live li", has_text=f"{name},").wait_for()
            waits.append(1e3 * (time.perf_counter() - start))
    return statistics.median(waits[1:]), max(waits[1:])


def memory(url, process):
    """Peak memory of the server after every tile was sent, MB."""
    count = 0
    for source in (0, 1):
        index = json.loads(urllib.request.urlopen(f"{url}data/{source}/index.json").read())
        for layer, entry in enumerate(index["layers"]):
            for level, piece in enumerate(entry["levels"]):
                for tile in range(-(-piece["rows"] // index["tile_rows"])):
                    urllib.request.urlopen(f"{url}data/{source}/tile/{layer}/{level}/{tile}").read()
                    count += 1
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024, count


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        home = Path(folder)
        results = [make_long_lane(home / "one", 12_000, 3), make_long_lane(home / "two", 12_000, 9)]
        browser = play.chromium.launch(
            executable_path=shutil.which("chromium") or "", args=FLAGS
        )  # as users have it
        for _ in range(options.rounds):
            page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
            with server(results[0]) as (url, _):
                first, colours, rate, worst, frame = look(page, url)
            print(
                f"first picture {first:.0f} ms; new colours {colours:.1f} ms at most; pan {rate:.0f} frames/s "
                f"(slowest {worst:.0f}), {frame:.1f} ms a frame at most; load {os.getloadavg()[0]:.1f}",
                flush=True,
            )
            page.context.close()
        page = browser.new_context().new_page()
        (home / "live").mkdir()
        usual, most = live_delay(page, home / "live")
        print(
            f"a live alarm stands on the page {usual:.0f} ms after its event (median), {most:.0f} ms at most"
        )
        with server(*results) as (url, process):
            peak, count = memory(url, process)
            print(f"server: {peak:.0f} MB at most, two results open and {count} tiles read")
        browser.close()


if __name__ == "__main__":
    main()

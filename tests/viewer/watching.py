"""A page in headless Chromium whose requests and errors are kept."""

import io
import shutil

import matplotlib
import numpy as np
from PIL import Image

# Debian's browser without windows draws the same pages with a third less work.
CHROMIUM = shutil.which("chromium-headless-shell") or shutil.which("chromium") or ""
FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--process-per-site", "--in-process-gpu",
    "--num-raster-threads=1", "--disable-extensions", "--disable-component-extensions-with-background-pages",
]  # fmt: skip
DRAG = """(steps) => new Promise((done) => {
    const canvas = document.getElementById('lane'), times = [];
    const box = canvas.getBoundingClientRect();
    const send = (type, x) => canvas.dispatchEvent(new PointerEvent(type,
        { clientX: box.left + x, clientY: box.top + 250, button: 0, buttons: 1, pointerId: 1, bubbles: true }));
    canvas.setPointerCapture = () => {};
    send('pointerdown', 600);
    let n = 0;
    const step = (now) => {
        times.push(now);
        send('pointermove', 600 - 9 * (n % 60));
        if (++n < steps) requestAnimationFrame(step);
        else { send('pointerup', 600); done(times); }
    };
    requestAnimationFrame(step);
})"""


def viridis(share):
    return 255 * np.array(matplotlib.colormaps["viridis"](share)[:3])


class Watched:
    """A page whose requests and errors are kept; a script may be run in it before its own."""

    def __init__(self, browser, viewer, size=(1280, 800), scheme="light", script=""):
        self.page = browser.new_page()
        self.page.add_init_script(script)
        self.page.set_viewport_size({"width": size[0], "height": size[1]})
        self.page.emulate_media(color_scheme=scheme)
        self.requests = []
        self.errors = []
        self.closed = False
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on(
            "console",
            lambda line: line.type in ("error", "warning") and self.errors.append(line.text),
        )
        self.origin = f"http://127.0.0.1:{viewer.port}/"
        self.page.goto(viewer.url)
        self.until("performance.getEntriesByName('flgpr:first-picture').length > 0")

    def close(self):
        """Close the page, before its server ends where it asks all the time, and look at what it did."""
        if self.closed:
            return
        self.closed = True
        self.page.close()
        assert self.errors == [], self.errors
        own = [url for url in self.requests if not url.startswith(("blob:", "data:"))]
        assert own
        assert all(url.startswith(self.origin) for url in own)

    def saved(self, button):
        self.page.click("#export-menu summary")
        with self.page.expect_download() as info:
            self.page.click(button)
        self.page.click("#export-menu summary")
        return info.value.suggested_filename, info.value.path().read_bytes()

    def pixels(self):
        """The lane's picture as an array, once what was asked for has come and is drawn."""
        for _ in range(2):
            self.page.evaluate(
                "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
            )
            self.until("document.getElementById('stage').getAttribute('aria-busy') !== 'true'")
        seen = Image.open(
            io.BytesIO(self.page.screenshot(clip=self.page.locator("#lane").bounding_box()))
        )
        return np.asarray(seen.convert("RGB")).astype(int)

    def settled(self):
        """The picture once it stands still: wheel and pointer are told to the page without waiting for it."""
        before = self.pixels()
        for _ in range(100):
            self.page.wait_for_timeout(50)
            now = self.pixels()
            if np.array_equal(now, before):
                return now
            before = now
        raise AssertionError("the picture does not stand still")

    def until(self, code):
        """Wait for a condition; by asking again, since the page allows no script from strings."""
        for _ in range(1200):
            if self.page.evaluate(code):
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(code)

    def text(self, selector):
        return self.page.inner_text(selector)

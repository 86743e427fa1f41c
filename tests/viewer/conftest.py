import threading
import time
from contextlib import contextmanager

import pytest
from watching import CHROMIUM, FLAGS, Watched

from flgpr.viewer import Viewer

PAGES = []
"""The pages that a test watches."""


@contextmanager
def running(shown, answers=False, **options):
    viewer = shown if isinstance(shown, Viewer) else Viewer(shown, **options)
    if answers:
        viewer.keep_answers()
    thread = threading.Thread(target=viewer.run)
    thread.start()
    try:
        for _ in range(500):
            if viewer._server.started:
                break
            time.sleep(0.01)
        yield viewer
    finally:
        try:
            # A page that still asks would be told that nobody answers.
            for page in PAGES:
                if page.origin == f"http://127.0.0.1:{viewer.port}/":
                    page.close()
        finally:
            viewer.stop()
            # Connections that a browser left open end after the server's own deadline of 30 s.
            thread.join(60)
            assert not thread.is_alive()


@pytest.fixture(scope="session")
def serving():
    """Start a viewer in a thread for as long as a ``with`` block lasts."""
    return running


@pytest.fixture(scope="session")
def shown(demo):
    with running([demo[0].folder]) as viewer:
        yield viewer


@pytest.fixture(scope="session")
def browser():
    """Give windows of one browser."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    if not CHROMIUM:
        pytest.skip("needs chromium")
    with sync_api.sync_playwright() as play:
        instance = play.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        # A process that has drawn a page before draws the next one in half the time: one page
        # stays, so that it lives.
        context = instance.new_context(accept_downloads=True, reduced_motion="reduce")
        page = context.new_page()
        page.route("**", lambda route: route.fulfill(body=""))
        page.goto("http://127.0.0.1/")
        yield context
        instance.close()


@pytest.fixture
def watch(browser):
    def start(viewer, **options):
        PAGES.append(Watched(browser, viewer, **options))
        return PAGES[-1]

    yield start
    pages = list(PAGES)
    PAGES.clear()
    for page in pages:
        page.close()

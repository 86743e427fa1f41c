"""``flgpr.view``: the page inside a notebook."""

import http.client
import re
import subprocess
import sys
import threading
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest

import flgpr
from flgpr.viewer.guard import SECURITY_HEADERS


def ask(url):
    _, host, path = re.fullmatch(r"(http)://([^/]+)(/.*)", url).groups()
    with closing(http.client.HTTPConnection(host, timeout=20)) as connection:
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.read()
        return answer


@pytest.fixture
def kernel(monkeypatch):
    """Make this process look like a notebook's kernel."""
    monkeypatch.setitem(
        sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=1))
    )


def test_it_serves_until_closed_and_twice_the_same_is_one_server(demo, kernel, capsys):
    folder = demo[0].folder
    first = flgpr.view(demo[0])
    assert ask(first.url).status == 200
    assert capsys.readouterr().out == ""
    shown = first._repr_html_()
    assert shown.startswith(f'<iframe src="{first.url}"')
    second = flgpr.view(folder, height=500)
    assert first.closed
    assert first._repr_html_() == "<p>This view was closed.</p>"
    assert 'height="500"' in second._repr_html_()
    both = flgpr.view(folder, folder)  # another view: both live
    assert ask(second.url).status == ask(both.url).status == 200
    for one in (second, both):
        one.close()
        one.close()
        with pytest.raises(OSError, match="refused"):
            ask(one.url)
        assert repr(one) == "flgpr view, closed"


@pytest.mark.slow("runs in processes of its own")
def test_without_a_notebook_the_address_is_printed(demo, capsys):
    shown = flgpr.view(demo[0].folder)
    assert (
        capsys.readouterr().out
        == f"no notebook is here to show it; open {shown.url} in a browser\n"
    )
    shown.close()
    code = f"import flgpr; v = flgpr.view({str(demo[0].folder)!r}); assert 'IPython' not in __import__('sys').modules"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stderr) == (0, ""), (
        ran.stderr
    )  # it ends though nobody closed the view
    assert "open http://127.0.0.1:" in ran.stdout


def test_what_cannot_be_shown_is_told_before_anything_listens(tmp_path):
    before = threading.enumerate()
    with pytest.raises(FileNotFoundError, match="nothing to view"):
        flgpr.view(tmp_path / "nothing")
    with pytest.raises(ValueError, match="paths must name a result"):
        flgpr.view()
    with pytest.raises(ValueError, match="height must be at least 100 pixels, got 5"):
        flgpr.view(tmp_path, height=5)
    assert set(threading.enumerate()) <= set(before)  # one of another test may have ended


class Page(BaseHTTPRequestHandler):
    """A notebook's page, of another origin of this machine."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(self.server.content.encode())

    def log_message(self, *_):
        pass


@pytest.mark.slow("a browser draws every page")
def test_only_pages_of_this_machine_may_frame_it(demo, kernel, shown, browser):
    """A frame of another origin, as a notebook's is, shows the lane; that of a plain viewer stays empty."""
    view = flgpr.view(demo[0])
    assert "localhost:*" in ask(view.url).getheader("content-security-policy")
    assert ask(view.url).getheader("x-frame-options") is None
    assert "frame-ancestors 'none'" in SECURITY_HEADERS["content-security-policy"]
    server = ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    page = browser.new_page()
    try:
        server.content = f"<!doctype html><body>{view._repr_html_()}"
        page.goto(f"http://localhost:{server.server_port}/")
        frame = page.frame_locator("iframe")
        frame.locator("#rows tr").first.wait_for(timeout=60_000)
        assert frame.locator("#title").inner_text().startswith(demo[0].folder.name)
        server.content = f'<!doctype html><body><iframe src="{shown.url}"></iframe>'
        with page.expect_event("console", lambda line: "frame" in line.text, timeout=60_000):
            page.goto(f"http://localhost:{server.server_port}/")
        assert page.frame_locator("iframe").locator("#title").count() == 0
    finally:
        page.close()
        server.shutdown()
        server.server_close()
        view.close()

"""Where a page may open: only before somebody who sits at a screen."""

import webbrowser

import pytest

from flgpr.commands.demo import has_browser, open_page


@pytest.mark.parametrize(
    ("environment", "platform", "is_terminal", "expected"),
    [
        ({"DISPLAY": ":0"}, "linux", True, True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True, True),
        ({}, "linux", True, False),
        ({"DISPLAY": ":0", "CI": "true"}, "linux", True, False),
        ({"DISPLAY": ":0"}, "linux", False, False),
        ({}, "darwin", True, True),
        ({}, "win32", True, True),
        ({"SSH_CONNECTION": "a 1 b 2"}, "darwin", True, False),
    ],
)
def test_a_browser_opens_only_before_a_screen(environment, platform, is_terminal, expected):
    assert has_browser(environment, platform, is_terminal) is expected


def test_no_browser_is_no_error(monkeypatch, tmp_path):
    def none(address):
        raise webbrowser.Error("none")

    monkeypatch.setattr(webbrowser, "open", none)
    assert open_page(tmp_path / "report.html") is False
    monkeypatch.setattr(webbrowser, "open", lambda address: address.startswith("file:///"))
    assert open_page(tmp_path / "report.html") is True

"""Whether a page can be shown to whoever typed a command."""

from __future__ import annotations

import os
import sys
import webbrowser
from collections.abc import Mapping
from pathlib import Path


def has_browser(
    environment: Mapping[str, str] | None = None,
    platform: str = sys.platform,
    is_terminal: bool | None = None,
) -> bool:
    """Return whether somebody sits at a screen on which a browser can open.

    Not where ``CI`` is set, the output goes to a file or a program, or there is no display.

    Parameters
    ----------
    environment : mapping, optional
        Environment variables, by default those of the process.
    platform : str
        As ``sys.platform``.
    is_terminal : bool, optional
        Whether the output is shown on a terminal, by default that of the process.

    Returns
    -------
    bool
        Whether one can open.
    """
    variables = os.environ if environment is None else environment
    if is_terminal is None:
        is_terminal = sys.stdout.isatty()
    if variables.get("CI") or not is_terminal:
        return False
    if platform in ("darwin", "win32", "cygwin"):
        return not variables.get("SSH_CONNECTION")
    return bool(variables.get("DISPLAY") or variables.get("WAYLAND_DISPLAY"))


def open_page(path: Path) -> bool:
    """Open a page of this machine in the browser, and return whether there was one."""
    try:
        return webbrowser.open(path.resolve().as_uri())
    except webbrowser.Error:
        return False

"""The viewer inside a notebook, served by the kernel for as long as it lives; the package has its name ``view``."""

from __future__ import annotations

import atexit
import html
import sys
import threading
from pathlib import Path

from flgpr.commands.exporting import map_bytes
from flgpr.commands.raw_run import RawRun
from flgpr.results.result import Result
from flgpr.viewer import Viewer

_open: dict[tuple[str, ...], View] = {}


class View:
    """A viewer that serves in a thread of its own until :meth:`close`; in a notebook its value is the page."""

    def __init__(self, viewer: Viewer, height: int) -> None:
        self._viewer = viewer
        self._height = height
        self._thread = threading.Thread(target=viewer.run, name="flgpr view", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    @property
    def url(self) -> str:
        """Address of the page, token included; it answers on this machine only."""
        return self._viewer.url

    @property
    def closed(self) -> bool:
        """Whether the server has ended."""
        return not self._thread.is_alive()

    def close(self) -> None:
        """End the server; the page that is shown answers no more."""
        self._viewer.stop()
        self._thread.join(10)
        atexit.unregister(self.close)

    def _repr_html_(self) -> str:
        if self.closed:
            return "<p>This view was closed.</p>"
        return (
            f'<iframe src="{html.escape(self.url)}" width="100%" height="{self._height}" frameborder="0" '
            'allow="clipboard-write" title="flgpr viewer"></iframe>'
        )

    def __repr__(self) -> str:
        return "flgpr view, closed" if self.closed else f"flgpr view at {self.url}"


def view(
    *results: str | Path | Result,
    score: str | Path | None = None,
    anchor: str | Path | None = None,
    live: str | Path | None = None,
    height: int = 800,
    port: int = 0,
) -> View:
    """Show results, two of them side by side, or a run in a notebook: the page of ``flgpr view`` as the cell's value.

    ``results`` are result folders or what ``read_result`` gave, or run stores; ``score`` is the score's
    folder if not the result's, ``anchor`` a TOML that ties the lane to the Earth, ``live`` the folder of a live run to
    follow; ``height`` is in pixels, and ``port`` 0 takes a free one. The server ends with the kernel, with
    :meth:`View.close`, or when the same is viewed again. Outside a notebook the address is printed, to be opened in a
    browser of this machine. Raises what ``flgpr view`` would say: ValueError or FileNotFoundError.
    """
    if not height >= 100:
        raise ValueError(f"height must be at least 100 pixels, got {height}")
    paths = [one.folder if isinstance(one, Result) else Path(one) for one in results]
    key = tuple(str(Path(one).resolve()) for one in (*paths, *([live] if live is not None else [])))
    if port and key in _open:  # its port may be the one that is asked for
        _open.pop(key).close()
    viewer = Viewer(
        paths,
        port=port,
        live=live,
        score=score,
        anchor=anchor,
        raw=RawRun,
        framed=True,
        make_map=map_bytes,
    )
    if key in _open:
        _open.pop(key).close()
    _open[key] = shown = View(viewer, height)
    if not _in_notebook():
        print(f"no notebook is here to show it; open {shown.url} in a browser")
    return shown


def _in_notebook() -> bool:
    """Tell whether a kernel runs this; IPython is loaded then, and not loaded to ask."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")

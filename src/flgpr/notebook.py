"""The viewer inside a notebook, served by the kernel for as long as it lives."""

from __future__ import annotations

import atexit
import html
import sys
import threading
from pathlib import Path

from flgpr.commands.exports import map_bytes
from flgpr.commands.raw_run import RawRun
from flgpr.results.result import Result
from flgpr.viewer import Viewer

_open: dict[tuple[str, ...], View] = {}


class View:
    """A viewer that runs in a thread of its own until :meth:`close`; a notebook shows its page."""

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
        """Stop the server; a page that is shown no longer responds."""
        self._viewer.stop()
        self._thread.join(10)
        atexit.unregister(self.close)

    def _repr_html_(self) -> str:
        if self.closed:
            return "<p>This view was closed.</p>"
        return (
            f'<iframe src="{html.escape(self.url)}" width="100%" height="{self._height}" '
            'frameborder="0" allow="clipboard-write" title="flgpr viewer"></iframe>'
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
    """Show results or a run in a notebook, as the page of ``flgpr view``.

    The server ends with the kernel, with :meth:`View.close`, or when the same is viewed again.
    Outside a notebook the address is printed, to be opened in a browser of this machine.

    Parameters
    ----------
    *results : str, Path or Result
        Result folders, results of ``read_result``, or run stores; two are shown side by side.
    score : str or Path, optional
        Folder of the score if it is not the result's.
    anchor : str or Path, optional
        TOML file that ties the lane to the Earth.
    live : str or Path, optional
        Folder of a live run to follow.
    height : int
        Height of the page in the notebook, pixels.
    port : int
        Port of the server; 0 takes a free one.

    Returns
    -------
    View
        The viewer, which a notebook shows.

    Raises
    ------
    ValueError
        If the height or an input is not valid.
    FileNotFoundError
        If an input does not exist.
    """
    if not height >= 100:
        raise ValueError(f"height must be at least 100 pixels, got {height}")
    paths = [result.folder if isinstance(result, Result) else Path(result) for result in results]
    inputs = paths if live is None else [*paths, Path(live)]
    key = tuple(str(path.resolve()) for path in inputs)
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
    shown = View(viewer, height)
    _open[key] = shown
    if not _in_notebook():
        print(f"no notebook is here to show it; open {shown.url} in a browser")
    return shown


def _in_notebook() -> bool:
    """Return whether a kernel of a notebook runs this, without loading IPython."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")

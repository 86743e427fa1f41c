"""The viewer's server.

Local by default, and read-only except for a file of verdicts where one is given, and for a driver's
answers where they are asked for.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import threading
import warnings
import webbrowser
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from flgpr import system
from flgpr.geo import map_backdrop, read_anchor
from flgpr.store import MOST_VERDICT_BYTES, RunStoreError
from flgpr.store.answers import MOST_ANSWER_BYTES, add_answer
from flgpr.types import Entries
from flgpr.viewer.guard import WILDCARDS, Guard, is_loopback
from flgpr.viewer.limits import (
    LimitedConfig,
    LimitedServer,
    Limits,
    fit_to_process,
)
from flgpr.viewer.session import (
    LIVE_FILE,
    LiveFile,
    ResultFiles,
    RunFiles,
    VerdictFile,
    ViewError,
    ViewSource,
    open_sources,
)

STATIC = {
    "": ("index.html", "text/html; charset=utf-8"),
    "app.js": ("app.js", "text/javascript; charset=utf-8"),
    "app.css": ("app.css", "text/css; charset=utf-8"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
}
VERDICTS_PATH = "/data/verdicts.json"
ANSWERS_PATH = "/data/answers"
_WAITING = 128  # connections that the system accepts before the server looks at them
_JSON = "application/json"
_BYTES = "application/octet-stream"

Endpoint = Callable[[Request], Awaitable[Response]]


class Raw(Protocol):
    """Computes raw data of a run for the viewer, which computes nothing itself.

    Whoever starts the viewer hands it in.
    """

    def answer(self, what: str, query: Mapping[str, str]) -> Entries:
        """Return a ``bscan``, a ``spectrum``, an ``image`` or the ``health``, by ``what``.

        Raises
        ------
        ValueError
            If the query breaks a rule.
        """
        ...


OpenRaw = Callable[[str | Path], Raw]
#: returns a zip of a map project: of a result folder, an anchor's file or None for the result's own
#: georeference, and a score's folder or None
MakeMap = Callable[[Path, Path | None, Path | None], bytes]


_RAW_DATA = ("bscan", "spectrum", "image", "health")
_MAP_MARGIN = 20.0  # m of map around what is shown, at least
_FORGED = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError)
"""What is raised on values of another kind than a file of this format has."""
_LONGEST_REASON = 120  # characters of such an error
_TOKEN_BYTES = 24  # random ones of the address, which nobody guesses


class Viewer:
    """A viewer that listens, and serves once :meth:`run` is called.

    Parameters
    ----------
    paths : sequence of path
        Results, runs, recordings or scores to show.
    host : str
        Address to listen on.
    port : int
        Port to listen on; 0 takes a free one.
    allow_remote : bool
        Whether the address may be reached from other machines.
    live : path, optional
        Folder or file of a live run's events.
    score : path, optional
        Folder of the first result's score, if that is not in it.
    anchor : path, optional
        TOML that ties lanes to the Earth.
    raw : callable, optional
        Opens the raw data of a run.
    backdrop : path, optional
        Map that :func:`flgpr.geo.map_backdrop` draws below the lanes.
    verdicts : path, optional
        File for an analyst's verdicts.
    framed : bool
        Whether pages of this machine may frame the page.
    make_map : callable, optional
        Returns a map project of a result.

    Raises
    ------
    ValueError
        If there is nothing to show, or the address cannot be listened on.
    """

    limits = Limits()  #: of the clients

    def __init__(
        self,
        paths: Sequence[str | Path],
        host: str = "127.0.0.1",
        port: int = 0,
        allow_remote: bool = False,
        live: str | Path | None = None,
        score: str | Path | None = None,
        anchor: str | Path | None = None,
        raw: OpenRaw | None = None,
        backdrop: str | Path | None = None,
        verdicts: str | Path | None = None,
        framed: bool = False,
        make_map: MakeMap | None = None,
    ) -> None:
        self._georeference = None if anchor is None else read_anchor(anchor).georeference()
        if not paths and live is None:
            raise ValueError("paths must name a result or a run to view, got none")
        if not is_loopback(host):
            _warn_of_remote_access(host, allow_remote)
        self._sources = open_sources(paths, score)
        if live is None and self._sources:
            folder = self._sources[0].folder
            if (folder / LIVE_FILE).is_file():
                live = folder
        self._live = None if live is None else LiveFile(live)
        self._backdrop = None if backdrop is None else self._draw_backdrop(backdrop)
        self._verdicts: VerdictFile | None = None
        if verdicts is not None:
            live_folders = [] if self._live is None else [self._live.folder]
            self._verdicts = VerdictFile(verdicts, self._sources, live_folders)
        self._anchor = None if anchor is None else Path(anchor)
        self._make_map = make_map
        self._score = None if score is None else Path(score)
        self._open_raw = raw
        self._raw = dict[int, Raw]()
        self._opening = threading.Lock()
        self.token = secrets.token_urlsafe(_TOKEN_BYTES)
        # Requests before run is called wait.
        self._socket = system.listening_socket(host, port, _WAITING, "host and port")
        self.host = host
        self.port = int(self._socket.getsockname()[1])
        #: paths that the page may write to, which the guard looks at with every request
        self._puts = set[str]()
        if self._verdicts is not None:
            self._puts.add(VERDICTS_PATH)
        app = Guard(
            Starlette(routes=self._routes()), self.token, host, self.port, self._puts, framed
        )
        self._server = LimitedServer(LimitedConfig(app, fit_to_process(self.limits)))

    @property
    def url(self) -> str:
        """Address of the page, token included."""
        host = socket.gethostname() if self.host in WILDCARDS else self.host
        return f"http://{system.address_text(host, self.port)}/{self.token}/"

    def keep_answers(self) -> None:
        """Let the page add a driver's answers to the log of the live run.

        Raises
        ------
        ValueError
            If there is no live run; the viewer listens no more then.
        """
        if self._live is None:
            self._socket.close()
            raise ValueError("answers need a live run that they are of, got none")
        self._puts.add(ANSWERS_PATH)

    def run(self) -> None:
        """Serve until :meth:`stop` or an interrupt."""
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._socket.close()

    def stop(self) -> None:
        """Let :meth:`run` end."""
        self._server.should_exit = True

    def _draw_backdrop(self, path: str | Path) -> tuple[bytes, list[float]]:
        """Return a map of all lanes and some ground around as PNG, and its x and y edges, m."""
        indices = [source.index for source in self._sources if "lane" in source.index]
        georeference = self._georeference
        for index in indices:
            georeference = georeference or index.get("georeference")
        if georeference is None or not indices:
            raise ValueError(
                "map needs a result or run that is tied to the Earth: give its `anchor`"
            )
        lanes = [index["lane"] for index in indices]
        x_min = min(lane["x_min"] for lane in lanes)
        x_max = max(lane["x_max"] for lane in lanes)
        y_min = min(lane["y_min"] for lane in lanes)
        y_max = max(lane["y_max"] for lane in lanes)
        margin = max(_MAP_MARGIN, 0.1 * (y_max - y_min))
        box = (x_min - margin, x_max + margin, y_min - margin, y_max + margin)
        image = map_backdrop(path, georeference, box)
        return image, [float(edge) for edge in box]

    def _routes(self) -> list[Route]:
        """Return the addresses that are answered."""
        source = "/data/{source:int}"
        answers: dict[str, Callable[[Request], Response]] = {
            "/data/session.json": self._session,
            "/data/live": self._live_events,
            "/data/backdrop.png": self._backdrop_image,
            f"{source}/index.json": self._of_source(lambda source, _: source.index_bytes(), _JSON),
            f"{source}/score.json": self._of_source(
                lambda source, _: source.score_bytes() or b"null", _JSON
            ),
            f"{source}/tile/{{layer:int}}/{{level:int}}/{{tile:int}}": self._of_source(
                lambda source, at: source.tile(at["layer"], at["level"], at["tile"])
            ),
            f"{source}/raw/{{what:str}}": self._raw_data,
            f"{source}/map.zip": self._map,
            f"{source}/evidence/{{detection:int}}/{{alarm:int}}": self._of_source(
                lambda source, at: source.evidence(at["detection"], at["alarm"])
            ),
        }
        for name in STATIC:
            answers[f"/{name}"] = _static(name)
        routes = [Route(path, _endpoint(read), methods=["GET"]) for path, read in answers.items()]
        if self._verdicts is not None:
            endpoint = _written(
                "verdicts are", MOST_VERDICT_BYTES, self._verdicts.write, self._verdicts.read
            )
            routes.append(Route(VERDICTS_PATH, endpoint, methods=["GET", "PUT"]))
        if self._live is not None:
            endpoint = _written(
                "answer is", MOST_ANSWER_BYTES, partial(add_answer, self._live.folder)
            )
            routes.append(Route(ANSWERS_PATH, endpoint, methods=["PUT"]))
        return routes

    def _session(self, request: Request) -> Response:  # noqa: ARG002
        """Return what the page can show."""
        identities = []
        for source in self._sources:
            identities.append(source.identity if isinstance(source, ResultFiles) else "")
        first_is_run = bool(self._sources) and isinstance(self._sources[0], RunFiles)
        session: Entries = {
            "results": [source.title for source in self._sources],
            "live": self._live is not None,
            "answers": ANSWERS_PATH in self._puts,
            "georeference": self._georeference,
            "verdicts": None if self._verdicts is None else self._verdicts.path.name,
            "identities": identities,
            "map": self._make_map is not None,
            "raw": self._open_raw is not None and first_is_run,
            "backdrop": None if self._backdrop is None else self._backdrop[1],
        }
        return _json_answer(session)

    def _backdrop_image(self, request: Request) -> Response:  # noqa: ARG002
        """Return the map below the lanes."""
        if self._backdrop is None:
            raise HTTPException(404)
        return _answer(self._backdrop[0], "image/png")

    def _raw_data(self, request: Request) -> Response:
        """Return what is computed of a run's raw data.

        400 and the reason if the query breaks a rule.
        """
        number = request.path_params["source"]
        what = request.path_params["what"]
        source = self._source(number)
        if self._open_raw is None or not isinstance(source, RunFiles) or what not in _RAW_DATA:
            raise HTTPException(404)
        pairs = request.query_params.multi_items()
        try:
            query = dict(pairs)
            if len(query) < len(pairs):
                raise ValueError("query must give every name once")
            # Pages ask for a picture and its spectrum at once: the run is opened for the first.
            with self._opening:
                if number not in self._raw:
                    self._raw[number] = self._open_raw(source.folder)
            return _json_answer(self._raw[number].answer(what, query), allow_nan=False)
        except RunStoreError as error:
            raise ViewError(str(error)) from None
        except ValueError as error:
            return _refusal(str(error), 400)

    def _source(self, number: int) -> ViewSource | None:
        """Return the source of a number; None if there is none."""
        return self._sources[number] if number < len(self._sources) else None

    def _map(self, request: Request) -> Response:
        """Return a map project of a result; 400 and the reason if it cannot be made."""
        number = request.path_params["source"]
        source = self._source(number)
        if self._make_map is None or not isinstance(source, ResultFiles):
            raise HTTPException(404)
        try:
            score = self._score if number == 0 else None
            archive = self._make_map(source.folder, self._anchor, score)
        except (ValueError, OSError, ImportError) as error:
            return _refusal(str(error), 400)
        return _answer(archive, "application/zip")

    def _of_source(
        self, read: Callable[[ViewSource, Mapping[str, int]], bytes | None], kind: str = _BYTES
    ) -> Callable[[Request], Response]:
        """Return an endpoint that reads of the source in the path, by the other numbers in it."""

        def answer(request: Request) -> Response:
            source = self._source(request.path_params["source"])
            if source is None:
                raise HTTPException(404)
            return _answer(read(source, request.path_params), kind)

        return answer

    def _live_events(self, request: Request) -> Response:
        """Return the events of a live run after a byte offset."""
        text = request.query_params.get("after", "0")
        is_offset = text.isascii() and text.isdigit() and len(text) < 16
        if self._live is None or not is_offset:
            return _answer(None, _JSON)
        return _json_answer(self._live.after(int(text)))


def serve(
    paths: str | Path | Sequence[str | Path],
    host: str = "127.0.0.1",
    port: int = 0,
    open_browser: bool = True,
    allow_remote: bool = False,
    live: str | Path | None = None,
    score: str | Path | None = None,
    anchor: str | Path | None = None,
    announce: Callable[[str], None] = print,
    answers: bool = False,
    **options: Any,
) -> None:
    """Show results in the browser until interrupted.

    Parameters
    ----------
    paths : path or sequence of path
        Results, runs, recordings or scores to show.
    host, port, allow_remote, live, score, anchor
        As for :class:`Viewer`.
    open_browser : bool
        Whether to open the page in the browser.
    announce : callable
        Called with the address of the page.
    answers : bool
        Whether the page may add a driver's answers to the log of the live run.
    **options
        Further options of :class:`Viewer`.
    """
    path_list = [paths] if isinstance(paths, str | Path) else list(paths)
    viewer = Viewer(path_list, host, port, allow_remote, live, score, anchor, **options)
    if answers:
        viewer.keep_answers()
    announce(viewer.url)
    if open_browser:
        threading.Timer(0.3, webbrowser.open, [viewer.url]).start()
    with contextlib.suppress(KeyboardInterrupt):
        viewer.run()


def _warn_of_remote_access(host: str, allow_remote: bool) -> None:
    """Warn that other machines reach the viewer; without their being allowed, refuse."""
    if not allow_remote:
        raise ValueError(
            f"host must be of this machine (127.0.0.1) unless remote access is on, got {host}"
        )
    warnings.warn(
        f"the viewer listens on {host}: whoever reaches it and learns the address with "
        "its token can read these results, and nothing on the way is encrypted",
        stacklevel=3,
    )


def _endpoint(read: Callable[[Request], Response]) -> Endpoint:
    """Return an endpoint that reads in a thread.

    500 and the reason if a file cannot be read or was altered, 422 if what it holds is not of the
    form that the page and this server know.
    """

    async def answer(request: Request) -> Response:
        try:
            return await run_in_threadpool(read, request)
        except ViewError as error:
            return _refusal(str(error), 500)
        except OSError as error:
            return _refusal(f"what is shown must be readable, got: {error.strerror or error}", 500)
        except _FORGED as error:
            return _refusal(
                "what is shown must have the form of its kind, got another: "
                f"{type(error).__name__} {str(error)[:_LONGEST_REASON]}",
                422,
            )

    return answer


def _written(
    what: str,
    most: int,
    write: Callable[[bytes], Entries],
    read: Callable[[], Entries] | None = None,
) -> Endpoint:
    """Return an endpoint that keeps what a page writes, and reads it where that is asked for.

    What breaks a rule is answered with the reason, and nothing is written.
    """

    async def answer(request: Request) -> Response:
        prefix = f"{what} not kept: "
        try:
            if read is not None and request.method != "PUT":
                prefix = ""
                return _json_answer(await run_in_threadpool(read))
            body = await _body(request, most)
            if body is None:
                return _refusal(f"{what} too large", 413)
            return _json_answer(await run_in_threadpool(write, body))
        except ClientDisconnect:  # nobody reads the answer, and nothing is written
            return Response(status_code=408)
        except (ValueError, OSError, RecursionError) as error:
            return _refusal(f"{prefix}{error}", 409)

    return answer


async def _body(request: Request, most: int) -> bytes | None:
    """Return the body of a request; None if it has more than so many bytes.

    It is counted while it arrives: what a header states of its length proves nothing.
    """
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > most:
            return None
    return bytes(body)


def _static(name: str) -> Callable[[Request], Response]:
    """Return an endpoint of a file of the page."""
    file, kind = STATIC[name]

    def answer(request: Request) -> Response:  # noqa: ARG001
        content = (resources.files("flgpr.viewer") / "static" / file).read_bytes()
        return _answer(content, kind)

    return answer


def _json_answer(content: Any, allow_nan: bool = True) -> Response:
    """Return JSON."""
    return _answer(json.dumps(content, allow_nan=allow_nan).encode(), _JSON)


def _refusal(reason: str, status: int) -> Response:
    """Return why a request is not answered, as JSON."""
    return Response(json.dumps({"error": reason}), status, media_type=_JSON)


def _answer(content: bytes | None, kind: str) -> Response:
    """Return content of a media type; 404 where there is none."""
    if content is None:
        return Response("404 not found\n", 404, media_type="text/plain")
    return Response(content, media_type=kind)

"""The server: on this machine unless told otherwise; reads only, but for a file of verdicts where one is named."""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import threading
import warnings
import webbrowser
from collections.abc import Awaitable, Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from flgpr.geo import map_backdrop, read_anchor
from flgpr.store import MOST_VERDICT_BYTES, RunStoreError
from flgpr.viewer.guard import Guard, is_loopback
from flgpr.viewer.limits import LimitedConfig, LimitedServer, Limits, fit_to_process
from flgpr.viewer.listening import listening_socket
from flgpr.viewer.session import (
    LIVE_FILE,
    LiveFile,
    ResultFiles,
    RunFiles,
    VerdictFile,
    ViewError,
    open_sources,
)

STATIC = {
    "": ("index.html", "text/html; charset=utf-8"),
    "app.js": ("app.js", "text/javascript; charset=utf-8"),
    "app.css": ("app.css", "text/css; charset=utf-8"),
    "icon.svg": ("icon.svg", "image/svg+xml"),
}
VERDICTS_PATH = "/data/verdicts.json"
_JSON = "application/json"
_BYTES = "application/octet-stream"

Endpoint = Callable[[Request], Awaitable[Response]]


class Raw(Protocol):
    """What works out raw data of a run, handed in by whoever starts the viewer, which computes nothing itself."""

    def answer(self, what: str, query: Mapping[str, str]) -> dict[str, Any]:
        """Answer a query for a ``bscan``, a ``spectrum``, an ``image`` or the ``health``; ValueError at fault."""
        ...


OpenRaw = Callable[[str | Path], Raw]
#: makes a zip of a map project of a result folder, tied by an anchor's file or else by itself, with a score's folder
MakeMap = Callable[[Path, Path | None, Path | None], bytes]


_AROUND = 20.0  # m of map around what is shown, at least


class Viewer:
    """A viewer that listens, and serves once :meth:`run` is called.

    ``raw`` opens the raw data of a run that is shown, ``backdrop`` is a map that :func:`flgpr.geo.map_backdrop` draws,
    ``verdicts`` the file that takes an analyst's verdicts; ``framed`` lets pages of this machine frame the page,
    and ``make_map`` makes a map project of a result. A port that cannot be listened on is a ValueError.
    """

    limits = Limits()  #: what clients may hold of the server

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
        self._georeference = read_anchor(anchor).georeference() if anchor is not None else None
        if not paths and live is None:
            raise ValueError("paths must name a result or a run to view, got none")
        if not is_loopback(host):
            if not allow_remote:
                raise ValueError(
                    f"host must be of this machine (127.0.0.1) unless remote access is on, got {host}"
                )
            warnings.warn(
                f"the viewer listens on {host}: whoever reaches it and learns the address with its token can read "
                "these results, and nothing on the way is encrypted",
                stacklevel=2,
            )
        self._sources = open_sources(paths, score)
        if live is None and self._sources and (self._sources[0].folder / LIVE_FILE).is_file():
            live = self._sources[0].folder
        self._live = None if live is None else LiveFile(live)
        self._backdrop = None if backdrop is None else self._drawn(backdrop)
        self._verdicts = (
            None
            if verdicts is None
            else VerdictFile(
                verdicts, self._sources, [] if self._live is None else [self._live.folder]
            )
        )
        self._anchor = None if anchor is None else Path(anchor)
        self._make_map = make_map
        self._score = None if score is None else Path(score)
        self._open_raw = raw
        self._raw = dict[int, Raw]()
        self._opening = threading.Lock()
        self.token = secrets.token_urlsafe(24)
        self._socket = listening_socket(host, port)  # who asks before run is called waits
        self.host, self.port = host, int(self._socket.getsockname()[1])
        puts = () if self._verdicts is None else (VERDICTS_PATH,)
        app = Guard(Starlette(routes=self._routes()), self.token, host, self.port, puts, framed)
        self._server = LimitedServer(LimitedConfig(app, fit_to_process(self.limits)))

    @property
    def url(self) -> str:
        """Address of the page, token included."""
        shown = socket.gethostname() if self.host in ("0.0.0.0", "::") else self.host  # noqa: S104
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{self.port}/{self.token}/"

    def run(self) -> None:
        """Serve until :meth:`stop` or an interrupt."""
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._socket.close()

    def stop(self) -> None:
        """Let :meth:`run` end."""
        self._server.should_exit = True

    def _drawn(self, path: str | Path) -> tuple[bytes, list[float]]:
        """Draw a map below all that is shown and some ground around it, and tell where it lies."""
        indices = [source.index for source in self._sources if "lane" in source.index]
        tie = self._georeference or next(
            (one["georeference"] for one in indices if one.get("georeference")), None
        )
        if tie is None or not indices:
            raise ValueError(
                "map needs a result or run that is tied to the Earth: give its --anchor"
            )
        x, y = (
            [one["lane"][f"{axis}_{end}"] for one in indices for end in ("min", "max")]
            for axis in "xy"
        )
        around = max(_AROUND, 0.1 * (max(y) - min(y)))
        box = min(x) - around, max(x) + around, min(y) - around, max(y) + around
        return map_backdrop(path, tie, box), [float(one) for one in box]

    def _routes(self) -> list[Route]:
        reads: dict[str, Callable[..., Response]] = {
            "/data/session.json": self._session,
            "/data/live": self._live_events,
            "/data/backdrop.png": self._ground_below,
            "/data/{source:int}/index.json": self._of(lambda one: one.index_bytes(), _JSON),
            "/data/{source:int}/score.json": self._of(
                lambda one: one.score_bytes() or b"null", _JSON
            ),
            "/data/{source:int}/tile/{layer:int}/{level:int}/{tile:int}": self._of(
                lambda one, **at: one.tile(**at)
            ),
            "/data/{source:int}/raw/{what:str}": self._raw_data,
            "/data/{source:int}/map.zip": self._map,
            "/data/{source:int}/evidence/{detection:int}/{alarm:int}": self._of(
                lambda one, **at: one.evidence(**at)
            ),
        }
        routes = [Route(path, _endpoint(read), methods=["GET"]) for path, read in reads.items()]
        if self._verdicts is not None:
            routes.append(
                Route(VERDICTS_PATH, self._of_verdicts(self._verdicts), methods=["GET", "PUT"])
            )
        return routes + [
            Route(f"/{name}", _endpoint(_static(name)), methods=["GET"]) for name in STATIC
        ]

    def _session(self, request: Request) -> Response:  # noqa: ARG002
        titles = [source.title for source in self._sources]
        told: dict[str, Any] = {
            "results": titles,
            "live": self._live is not None,
            "georeference": self._georeference,
        }
        told["verdicts"] = None if self._verdicts is None else self._verdicts.path.name
        told["identities"] = [
            one.identity if isinstance(one, ResultFiles) else "" for one in self._sources
        ]
        told["map"] = self._make_map is not None
        told["raw"] = (
            self._open_raw is not None
            and bool(self._sources)
            and isinstance(self._sources[0], RunFiles)
        )
        told["backdrop"] = None if self._backdrop is None else self._backdrop[1]
        return _answer(json.dumps(told).encode(), _JSON)

    def _ground_below(self, request: Request) -> Response:  # noqa: ARG002
        if self._backdrop is None:
            raise HTTPException(404)
        return _answer(self._backdrop[0], "image/png")

    def _raw_data(self, request: Request) -> Response:
        """Answer with what is worked out of a run's raw data; a query that breaks a rule is told so (400)."""
        number = request.path_params["source"]
        what = request.path_params["what"]
        source = self._sources[number] if number < len(self._sources) else None
        if (
            self._open_raw is None
            or not isinstance(source, RunFiles)
            or what not in ("bscan", "spectrum", "image", "health")
        ):
            raise HTTPException(404)
        pairs = request.query_params.multi_items()
        try:
            if len({name for name, _ in pairs}) < len(pairs):
                raise ValueError("query must give every name once")
            with self._opening:
                if number not in self._raw:
                    self._raw[number] = self._open_raw(source.folder)
            return _answer(
                json.dumps(self._raw[number].answer(what, dict(pairs)), allow_nan=False).encode(),
                _JSON,
            )
        except RunStoreError as error:
            raise ViewError(str(error)) from None
        except ValueError as error:
            return Response(json.dumps({"error": str(error)}), 400, media_type=_JSON)

    def _map(self, request: Request) -> Response:
        """Answer with a map project of a result; what stands against it is told so (400)."""
        number = request.path_params["source"]
        source = self._sources[number] if number < len(self._sources) else None
        if self._make_map is None or not isinstance(source, ResultFiles):
            raise HTTPException(404)
        try:
            score = self._score if number == 0 else None
            return _answer(self._make_map(source.folder, self._anchor, score), "application/zip")
        except (ValueError, OSError, ImportError) as error:
            return Response(json.dumps({"error": str(error)}), 400, media_type=_JSON)

    def _of(
        self, read: Callable[..., bytes | None], kind: str = _BYTES
    ) -> Callable[[Request], Response]:
        """Answer with what is read of the source that the path names, at the numbers that it names."""

        def answer(request: Request) -> Response:
            number = request.path_params["source"]
            rest = {k: v for k, v in request.path_params.items() if k != "source"}
            if number >= len(self._sources):
                raise HTTPException(404)
            return _answer(read(self._sources[number], **rest), kind)

        return answer

    def _of_verdicts(self, file: VerdictFile) -> Endpoint:
        """Answer with the verdicts, and take those of the page; what breaks a rule is told so, and nothing written."""

        async def answer(request: Request) -> Response:
            try:
                if request.method != "PUT":
                    return _answer(json.dumps(await run_in_threadpool(file.read)).encode(), _JSON)
                body = bytearray()
                async for part in request.stream():
                    body += part
                    if len(body) > MOST_VERDICT_BYTES:
                        return Response(
                            json.dumps({"error": "verdicts are too large"}), 413, media_type=_JSON
                        )
                return _answer(
                    json.dumps(await run_in_threadpool(file.write, bytes(body))).encode(), _JSON
                )
            except ClientDisconnect:  # nobody reads the answer, and nothing is written
                return Response(status_code=408)
            except (ValueError, OSError, RecursionError) as error:
                head = "verdicts are not saved: " if request.method == "PUT" else ""
                return Response(json.dumps({"error": f"{head}{error}"}), 409, media_type=_JSON)

        return answer

    def _live_events(self, request: Request) -> Response:
        text = request.query_params.get("after", "0")
        if self._live is None or not (text.isascii() and text.isdigit() and len(text) < 16):
            return _answer(None, _JSON)
        return _answer(json.dumps(self._live.after(int(text))).encode(), _JSON)


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
    **more: Any,
) -> None:
    """Show results in the browser until interrupted; ``more`` are further options of :class:`Viewer`."""
    several = [paths] if isinstance(paths, str | Path) else list(paths)
    viewer = Viewer(several, host, port, allow_remote, live, score, anchor, **more)
    announce(viewer.url)
    if open_browser:
        threading.Timer(0.3, webbrowser.open, [viewer.url]).start()
    with contextlib.suppress(KeyboardInterrupt):
        viewer.run()


def _endpoint(read: Callable[[Request], Response]) -> Endpoint:
    async def answer(request: Request) -> Response:
        try:
            return await run_in_threadpool(read, request)
        except ViewError as error:
            return Response(json.dumps({"error": str(error)}), 500, media_type=_JSON)
        except OSError as error:
            words = f"what is shown must be readable, got: {error.strerror or error}"
            return Response(json.dumps({"error": words}), 500, media_type=_JSON)

    return answer


def _static(name: str) -> Callable[[Request], Response]:
    file, kind = STATIC[name]

    def answer(request: Request) -> Response:  # noqa: ARG001
        content = (resources.files("flgpr.viewer") / "static" / file).read_bytes()
        return _answer(content, kind)

    return answer


def _answer(content: bytes | None, kind: str) -> Response:
    if content is None:
        return Response("404 not found\n", 404, media_type="text/plain")
    return Response(content, media_type=kind)

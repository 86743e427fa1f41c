"""Who may ask: the right host, the right origin, the token; everyone else gets 403, on every route."""

from __future__ import annotations

import ipaddress
import secrets
import socket
from collections.abc import Collection

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SECURITY_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}
_OWN_PAGES = (
    "http://localhost:* http://127.0.0.1:* https://localhost:* https://127.0.0.1:* vscode-webview:"
)
_WILDCARDS = ("0.0.0.0", "::")  # noqa: S104


def is_loopback(host: str) -> bool:
    """Tell whether a host to listen on, ``localhost`` or an address, can be reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Guard:
    """Lets a request through only if host, origin and token are right.

    GET and HEAD are answered, and PUT on the paths of ``puts``.
    The token is the first part of the path, which the guarded app does not see: other ports of this machine would share
    a cookie. ``framed`` lets pages of this machine, such as a notebook's, frame the answers. On a wildcard address any
    literal address and this machine's own name are right, foreign names are not.
    """

    def __init__(
        self,
        app: ASGIApp,
        token: str,
        host: str,
        port: int,
        puts: Collection[str] = (),
        framed: bool = False,
    ) -> None:
        self._app = app
        self._token = token
        self._port = port
        self._puts = puts
        own = f"[{host}]" if ":" in host else host.lower()
        names = {"127.0.0.1", "localhost", "[::1]"} if is_loopback(host) else {own}
        self._wildcard = host in _WILDCARDS
        if self._wildcard:
            names |= {socket.gethostname().lower(), "localhost"}
        self._names = names
        self._headers = dict(SECURITY_HEADERS)
        if framed:
            del self._headers["x-frame-options"]
            policy = self._headers["content-security-policy"]
            ancestors = f"frame-ancestors {_OWN_PAGES}"
            self._headers["content-security-policy"] = policy.replace(
                "frame-ancestors 'none'", ancestors
            )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        inner = self._inner_path(scope["path"])
        if inner is None or not self._right_place(Headers(scope=scope)):
            await PlainTextResponse("403 forbidden\n", 403, self._headers)(scope, receive, send)
            return
        allowed = ["GET", "HEAD", "PUT"] if inner in self._puts else ["GET", "HEAD"]
        if scope["method"] not in allowed:
            headers = self._headers | {"allow": ", ".join(allowed)}
            await PlainTextResponse(f"405 only {', '.join(allowed)}\n", 405, headers)(
                scope, receive, send
            )
            return

        async def send_secured(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(name.encode(), value.encode()) for name, value in self._headers.items()]
                message["headers"] = [*message.get("headers", []), *own]
            await send(message)

        await self._app({**scope, "path": inner, "raw_path": inner.encode()}, receive, send_secured)

    def _inner_path(self, path: str) -> str | None:
        head, _, rest = path.removeprefix("/").partition("/")
        right = secrets.compare_digest(head.encode(), self._token.encode())
        return "/" + rest if right and path.startswith(f"/{head}/") else None

    def _right_place(self, headers: Headers) -> bool:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return False
        origins = headers.getlist("origin")
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
            return False
        site = headers.get("sec-fetch-site", "none")
        return site in ("none", "same-origin") or headers.get("sec-fetch-mode") == "navigate"

    def _is_own(self, host: str) -> bool:
        name, separator, port = host.lower().rpartition(":")
        if not separator or port != str(self._port):
            return False
        return name in self._names or (self._wildcard and _is_address(name))


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True

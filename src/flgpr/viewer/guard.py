"""Access to the viewer: right host, right origin and the token; any other request gets 403."""

from __future__ import annotations

import ipaddress
import re
import secrets
import socket
from collections.abc import Collection

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SECURITY_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; "
        "img-src 'self' blob: data:; connect-src 'self'; "
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
_LOCAL_PAGES = (
    "http://localhost:* http://127.0.0.1:* https://localhost:* https://127.0.0.1:* vscode-webview:"
)
WILDCARDS = ("0.0.0.0", "::")  # noqa: S104


def is_loopback(host: str) -> bool:
    """Return whether a host to listen on can be reached from this machine only.

    The host is ``localhost`` or an address.
    """
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


_MOST_DIGITS = 30
_LONG_NUMBER = re.compile(rf"\d{{{_MOST_DIGITS}}}")
"""A number that no page asks for, and that no type of numbers holds."""


class Guard:
    """Lets a request through only if host, origin and token are right.

    The token is the first component of the path, which the guarded app does not see: a cookie would
    be shared with other ports of this machine. On a wildcard address any literal address and this
    machine's own name are right, foreign names are not.

    Parameters
    ----------
    app : ASGIApp
        The guarded app.
    token : str
        Secret in the path.
    host : str
        Address that is listened on.
    port : int
        Port that is listened on.
    puts : collection of str
        Paths that take PUT besides GET and HEAD.
    framed : bool
        Whether pages of this machine, such as a notebook's, may frame the answers.
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
        if is_loopback(host):
            names = {"127.0.0.1", "localhost", "[::1]"}
        else:
            names = {f"[{host}]" if ":" in host else host.lower()}
        self._wildcard = host in WILDCARDS
        if self._wildcard:
            names |= {socket.gethostname().lower(), "localhost"}
        self._names = names
        self._headers = dict(SECURITY_HEADERS)
        if framed:
            del self._headers["x-frame-options"]
            policy = self._headers["content-security-policy"]
            policy = policy.replace("frame-ancestors 'none'", f"frame-ancestors {_LOCAL_PAGES}")
            self._headers["content-security-policy"] = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        inner = self._inner_path(scope["path"])
        if inner is None or not self._is_addressed_here(Headers(scope=scope)):
            refusal = PlainTextResponse("403 forbidden\n", 403, self._headers)
            await refusal(scope, receive, send)
            return
        allowed = ["GET", "HEAD", "PUT"] if inner in self._puts else ["GET", "HEAD"]
        asked = inner + "?" + scope.get("query_string", b"").decode("latin-1")
        if _LONG_NUMBER.search(asked):
            reason = f"400 numbers of an address have fewer than {_MOST_DIGITS} digits\n"
            await PlainTextResponse(reason, 400, self._headers)(scope, receive, send)
            return
        if scope["method"] not in allowed:
            methods = ", ".join(allowed)
            headers = self._headers | {"allow": methods}
            refusal = PlainTextResponse(f"405 only {methods}\n", 405, headers)
            await refusal(scope, receive, send)
            return

        async def send_secured(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = list(message.get("headers", []))
                for name, value in self._headers.items():
                    headers.append((name.encode(), value.encode()))
                message["headers"] = headers
            await send(message)

        await self._app({**scope, "path": inner, "raw_path": inner.encode()}, receive, send_secured)

    def _inner_path(self, path: str) -> str | None:
        """Return the path without the token; None if the token is wrong."""
        head, _, rest = path.removeprefix("/").partition("/")
        is_right = secrets.compare_digest(head.encode(), self._token.encode())
        if not is_right or not path.startswith(f"/{head}/"):
            return None
        return "/" + rest

    def _is_addressed_here(self, headers: Headers) -> bool:
        """Return whether host, origin and fetch metadata are those of this server's own page."""
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return False
        origins = headers.getlist("origin")
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
            return False
        site = headers.get("sec-fetch-site", "none")
        is_navigation = headers.get("sec-fetch-mode") == "navigate"
        return site in ("none", "same-origin") or is_navigation

    def _is_own(self, host: str) -> bool:
        """Return whether a host header names this server."""
        name, separator, port = host.lower().rpartition(":")
        if not separator or port != str(self._port):
            return False
        return name in self._names or (self._wildcard and _is_address(name))


def _is_address(name: str) -> bool:
    """Return whether a name is a literal IP address."""
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True

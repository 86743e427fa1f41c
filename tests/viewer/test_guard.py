"""The guard: right host, origin and token, or 403, whatever the app would answer."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import pytest

from flgpr.viewer.guard import Guard, is_loopback


async def app(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": scope["path"].encode()})


def ask(guard, path="/secret/data", method="GET", **headers):
    """Return status, headers and body of a request."""
    sent = []

    async def send(message):
        sent.append(message)

    pairs = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": "http", "method": method, "path": path, "headers": pairs}
    # The browser of other tests keeps a loop running in this thread.
    with ThreadPoolExecutor(1) as executor:
        executor.submit(asyncio.run, guard(scope, None, send)).result()
    body = b"".join(message.get("body", b"") for message in sent)
    return sent[0]["status"], dict(sent[0]["headers"]), body


def test_the_app_sees_the_path_without_the_token():
    guard = Guard(app, "secret", "127.0.0.1", 80)
    status, headers, body = ask(guard, host="127.0.0.1:80")
    assert (status, body) == (200, b"/data")
    assert headers[b"x-frame-options"] == b"DENY"


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/other/data", {"host": "127.0.0.1:80"}),
        ("/secret", {"host": "127.0.0.1:80"}),
        ("/secret/data", {"host": "127.0.0.1:81"}),
        ("/secret/data", {"host": "example.org:80"}),
        ("/secret/data", {"host": "127.0.0.1:80", "origin": "http://example.org"}),
        ("/secret/data", {"host": "127.0.0.1:80", "sec_fetch_site": "cross-site"}),
    ],
)
def test_strangers_are_refused(path, headers):
    assert ask(Guard(app, "secret", "127.0.0.1", 80), path, **headers)[0] == 403


def test_put_is_for_named_paths_only():
    guard = Guard(app, "secret", "127.0.0.1", 80, puts=("/data",))
    assert ask(guard, method="PUT", host="localhost:80")[0] == 200
    status, headers, _ = ask(guard, "/secret/other", method="PUT", host="localhost:80")
    assert (status, headers[b"allow"]) == (405, b"GET, HEAD")


def test_on_a_wildcard_any_address_is_right_and_foreign_names_are_not():
    guard = Guard(app, "secret", "0.0.0.0", 80)
    assert ask(guard, host="192.0.2.7:80")[0] == 200
    assert ask(guard, host="example.org:80")[0] == 403


def test_a_framed_page_may_be_framed_by_this_machine_only():
    guard = Guard(app, "secret", "127.0.0.1", 80, framed=True)
    headers = ask(guard, host="127.0.0.1:80")[1]
    assert b"x-frame-options" not in headers
    assert b"frame-ancestors http://localhost:*" in headers[b"content-security-policy"]


@pytest.mark.parametrize(
    ("host", "expected"),
    [("localhost", True), ("127.0.0.9", True), ("::1", True), ("0.0.0.0", False), ("a.org", False)],
)
def test_loopback_is_this_machine_only(host, expected):
    assert is_loopback(host) is expected

"""A socket that listens, or the reason why it cannot."""

import socket

import pytest
from typer.testing import CliRunner

from flgpr import view
from flgpr.commands.app import app
from flgpr.store import sample_lane
from flgpr.system import listening_socket
from flgpr.viewer import Viewer

RUN = sample_lane() / "run.zarr"


@pytest.fixture
def taken_port():
    with socket.create_server(("127.0.0.1", 0)) as other:
        yield other.getsockname()[1]


def test_a_port_in_use_is_named_with_what_to_do(taken_port):
    words = f"got 127.0.0.1:{taken_port}: another program listens on it; port 0 takes a free one"
    with pytest.raises(ValueError, match=words):
        Viewer([RUN], port=taken_port)
    with pytest.raises(ValueError, match=words):
        view(RUN, port=taken_port)
    done = CliRunner().invoke(app, ["view", str(RUN), "--port", str(taken_port), "--no-browser"])
    assert done.exit_code == 2
    assert words in done.output
    assert len(done.output.splitlines()) == 1
    assert "Errno" not in done.output


@pytest.mark.parametrize(
    ("host", "error", "words"),
    [
        (
            "192.0.2.1",
            None,
            "host and port must be an .* got 192.0.2.1:80: this machine has no such address",
        ),
        ("nowhere.invalid", None, "got nowhere.invalid:80: this machine has no such address"),
        (
            "127.0.0.1",
            PermissionError(13, "Permission denied"),
            "got 127.0.0.1:80: this user may listen on ports from 1024 on",
        ),
        (
            "127.0.0.1",
            OSError(24, "Too many open files"),
            "got 127.0.0.1:80: Too many open files",
        ),
    ],
)
def test_what_cannot_be_listened_on_is_told_in_words(monkeypatch, host, error, words):
    if error is not None:

        def refuse(self, address):
            raise error

        monkeypatch.setattr(socket, "socket", type("Refusing", (socket.socket,), {"bind": refuse}))
    with pytest.raises(ValueError, match=words) as told:
        listening_socket(host, 80, 1, "host and port")
    assert "Errno" not in str(told.value)


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_no_address_has_is_refused(port):
    with pytest.raises(ValueError, match=f"port must be 0 to 65535, got {port}"):
        Viewer([RUN], port=port)

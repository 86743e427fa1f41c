"""The page from a NumPy file to live alarms: its program and its commands, run in their order."""

import shlex
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from flgpr.store import open_run, read_table
from reading import FENCE, ROOT, SHELL, file_shown, read, shell_lines

pytestmark = pytest.mark.slow("simulates and imports a lane for the page")

PAGE = ROOT / "docs" / "guide" / "own-array.md"
PORT = "5601"
MINES = [(0.4, 9.0), (-0.6, 11.5), (0.1, 14.0)]


FURTHER = "## Signatures for your array"


def first_part():
    """Return the page up to the commands that are not among the four."""
    return read(PAGE).split(FURTHER)[0]


def commands(text):
    lines = []
    for kind, body in FENCE.findall(text):
        if kind in SHELL:
            lines += [line for line in shell_lines(body) if line.startswith("flgpr ")]
    return lines


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return str(server.getsockname()[1])


def start(line, folder, port, *more):
    """Start a command of the page, without a browser and on a port that is free."""
    words = [word.replace(PORT, port) for word in shlex.split(line, comments=True)[1:]]
    words = [word for word in words if word != "--view"]
    return subprocess.Popen(
        [sys.executable, "-m", "flgpr", *words, *more],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finished(process):
    output, _ = process.communicate(timeout=300)
    assert process.returncode == 0, output
    return output


def wait_until_it_listens(process, port):
    last = time.monotonic() + 120
    while True:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", int(port))) == 0:
                return
        assert process.poll() is None
        assert time.monotonic() < last
        time.sleep(0.1)


def test_there_are_at_most_four_commands():
    words = [line.split()[1] for line in commands(first_part())]
    assert words == ["info", "import", "live", "feed"]


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """The folder of somebody who followed the page, and what each command printed."""
    folder = tmp_path_factory.mktemp("own")
    text = first_part()
    info, imported, live, feed = commands(text)
    port = free_port()
    [program] = [body for kind, body in FENCE.findall(text) if kind == "python"]
    subprocess.run([sys.executable, "-c", program], cwd=folder, check=True, timeout=120)
    printed = [finished(start(info, folder, port))]
    draft = (folder / "array.toml").read_text()
    for fence in FENCE.finditer(text):
        if fence[1] == "toml":
            assert file_shown(text, fence.start()) == "array.toml"
            (folder / "array.toml").write_text(fence[2])
    printed.append(finished(start(imported, folder, port)))
    drive = start(live, folder, port)
    wait_until_it_listens(drive, port)
    printed.append(finished(start(feed, folder, port, "--rate", "0", "--lead", "0")))
    printed.append(finished(drive))
    return folder, printed, draft


def test_the_draft_asks_for_what_the_page_says_and_gets_the_rest(followed):
    _, printed, draft = followed
    assert "with 2 question marks" in printed[0]
    asked = [line for line in draft.splitlines() if "?" in line and not line.startswith("#")]
    assert [line.split(" =")[0] for line in asked] == ["polarization", "angle_unit"]


def test_the_run_is_that_of_the_arrays_file(followed):
    folder = followed[0]
    run = open_run(folder / "array.zarr")
    scans = np.load(folder / "scans.npy")
    np.testing.assert_array_equal(run["signal"].values[:, 0].reshape(scans.shape), scans)
    np.testing.assert_allclose(run["pose"].values[:, 1], 0.6 * np.arange(24))


def test_the_first_alarms_are_the_scatterers(followed):
    folder, printed, _ = followed
    assert "played 24 scans" in printed[2]
    assert '"event":"alarm"' in printed[3]
    alarms = read_table(folder / "drive" / "alarms.csv", "alarms").head(len(MINES))
    found = sorted(zip(alarms["x"], alarms["y"], strict=True), key=lambda place: place[1])
    np.testing.assert_allclose(found, MINES, atol=0.1)
    assert alarms["confidence"].min() > 10

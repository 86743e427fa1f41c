"""The page that is shipped is the one of the sources."""

import re
import shutil
import subprocess
from importlib import resources
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[2] / "viewer"
STATIC = resources.files("flgpr.viewer") / "static"


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node")
@pytest.mark.skipif(not (SOURCES / "node_modules").is_dir(), reason="needs npm ci in viewer/")
@pytest.mark.slow("builds the bundle")
def test_the_bundle_is_that_of_the_sources():
    done = subprocess.run(
        [SOURCES / "build.sh", "--check"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_page_runs_nothing_inline_and_asks_no_other_origin():
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"<style|<script(?! src)|\son\w+=|\sstyle=|javascript:", page)
    assert not re.findall(r'(?:src|href)="(?!app\.js|app\.css|icon\.svg)', page)
    styles = (STATIC / "app.css").read_text(encoding="utf-8")
    assert "url(" not in styles
    assert "@import" not in styles
    script = (STATIC / "app.js").read_text(encoding="utf-8")
    assert set(re.findall(r"https?://[\w./-]+", script)) <= {"http://www.w3.org/2000/svg"}
    assert not re.search(r"\beval\(|new Function\(", script)


def test_the_lock_file_names_no_registry():
    lock = (SOURCES / "package-lock.json").read_text(encoding="utf-8")
    assert "resolved" not in lock
    assert "http" not in re.sub(r'"url": "https://[^"]*"', "", lock)
    assert '"integrity"' in lock

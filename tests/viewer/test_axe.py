"""What axe-core, a checker of accessibility, finds on the pages: minor things, and no empty header of a table."""

from pathlib import Path

import pytest
from test_drive_page import BEGIN, Screen
from test_live_page import Feeder, alarm, scan

from flgpr.commands.raw_run import RawRun
from flgpr.viewer import Viewer
from raw_lane import make_raw_lane

AXE = Path(__file__).parents[2] / "viewer/node_modules/axe-core/axe.min.js"
RUN = """() => axe.run(document, { resultTypes: ['violations'] }).then(({ violations }) => violations
    .map(({ id, impact, nodes }) => ({ id, impact, where: nodes.map((node) => node.target.join(' ')) })))"""

pytestmark = [
    pytest.mark.skipif(not AXE.is_file(), reason="needs npm ci in viewer/"),
    pytest.mark.slow("a browser draws every page"),
]


def findings(page):
    """Return what axe-core finds on a page that is more than minor, and its empty table headers."""
    page.evaluate(AXE.read_text(encoding="utf-8") + "; 0")
    found = page.evaluate(RUN)
    return [one for one in found if one["impact"] != "minor" or one["id"] == "empty-table-header"]


@pytest.mark.parametrize(
    ("scheme", "size"), [("light", (1280, 800)), ("dark", (1280, 800)), ("light", (390, 844))]
)
def test_a_result_with_an_open_alarm(watch, shown, scheme, size):
    one = watch(shown, size=size, scheme=scheme)
    one.page.keyboard.press("n")
    one.page.wait_for_selector("#patches canvas")
    one.page.keyboard.press("s")
    assert findings(one.page) == []
    one.page.keyboard.press("?")
    assert findings(one.page) == []


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_a_report(browser, demo, size):
    page = browser.new_page()
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto((demo[0].folder / "report.html").as_uri())
    assert findings(page) == []
    page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true })")
    assert findings(page) == []
    page.close()


def test_patches_scroll_by_keyboard(watch, shown):
    one = watch(shown, size=(1024, 768))
    one.page.keyboard.press("n")
    one.page.wait_for_selector("#patches canvas")
    one.page.focus("#patches")
    before = one.page.evaluate("[patches.scrollLeft, patches.scrollWidth - patches.clientWidth]")
    assert before[0] == 0
    assert before[1] > 0
    one.page.keyboard.press("ArrowRight")
    one.until("patches.scrollLeft > 0")


def test_raw_data_of_a_run(watch, serving, tmp_path):
    make_raw_lane(tmp_path / "run.zarr", scans=60)
    with serving(Viewer([tmp_path / "run.zarr"], raw=RawRun)) as viewer:
        one = watch(viewer)
        one.until("document.querySelectorAll('#health-rows tr').length > 0")
        assert findings(one.page) == []


@pytest.mark.parametrize("size", [(1280, 800), (800, 1280)])
def test_a_live_run_at_the_desk_and_on_the_drivers_screen(watch, serving, tmp_path, size):
    feeder = Feeder(tmp_path)
    feeder.give(BEGIN, scan(0, 0.0), scan(1, 1.0))
    feeder.give(*(alarm(f"alarm-{k}", 0.1 * k, 4.0 + k, 4.5, 1.0) for k in range(12)))
    with serving([], live=tmp_path, answers=True) as viewer:
        one = watch(viewer, size=size)
        Screen(one, tmp_path).alive()
        one.until("document.getElementById('drive-where').textContent.endsWith(' ahead')")
        assert findings(one.page) == []
        one.page.click("#to-desk")
        assert findings(one.page) == []
        one.close()

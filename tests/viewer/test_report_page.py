"""The report in a browser: how long it is, what its swipe shows, and what is printed."""

import pytest

HEIGHT = "document.documentElement.scrollHeight"
SHOWS_TABLE = "document.querySelector('details table').checkVisibility()"
BEGIN = "getComputedStyle(document.querySelector('.after')).clipPath"
SCREEN = (1280, 800)


@pytest.fixture
def report(browser, demo):
    page = browser.new_page()
    page.set_viewport_size({"width": SCREEN[0], "height": SCREEN[1]})
    page.goto((demo[0].folder / "report.html").as_uri())
    yield page
    page.close()


@pytest.mark.slow("a browser draws every page")
def test_the_page_takes_three_screens_at_most_and_begins_with_the_road(report):
    assert report.evaluate(HEIGHT) <= 3 * SCREEN[1]
    assert not report.evaluate(SHOWS_TABLE)
    assert report.locator("img").first.bounding_box()["y"] < SCREEN[1] / 4
    report.set_viewport_size({"width": 390, "height": 844})
    assert report.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.slow("a browser draws every page")
def test_the_picture_after_begins_where_the_pointer_is_or_a_key_put_it(report):
    assert report.evaluate(BEGIN) == "inset(0px 0px 0px 60%)"
    stage = report.locator(".stage").bounding_box()
    report.mouse.move(stage["x"] + 0.26 * stage["width"], stage["y"] + 20)
    assert report.evaluate(BEGIN) == "inset(0px 0px 0px 25%)"
    report.mouse.move(2, 2)
    report.locator(".strips input").nth(12).focus()
    report.keyboard.press("ArrowRight")
    assert report.evaluate(BEGIN) == "inset(0px 0px 0px 65%)"


@pytest.mark.slow("a browser draws every page")
def test_what_is_folded_is_printed(report):
    report.emulate_media(media="print")
    assert report.evaluate(SHOWS_TABLE)
    assert report.evaluate(BEGIN) == "none"

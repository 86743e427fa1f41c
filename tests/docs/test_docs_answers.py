"""The short pages of answers: the answer stands first, and their figures are those of the code and of the evidence."""

import re

import pytest
import yaml

from flgpr.health.findings import QUESTIONS
from flgpr.model.vehicle import Vehicle
from flgpr.recipe.schema import recipe_names
from flgpr.recipe.suggest import evidence
from reading import FENCE, ROOT, read

pytestmark = pytest.mark.slow("checks of pages")

GUIDE = ROOT / "docs" / "guide"
ANSWERS = {
    "which-threshold": "Which threshold",
    "which-recipe": "Which recipe",
    "is-my-sign-right": "Is my sign right",
    "how-fast": "How fast may I drive",
    "what-to-do-with-an-alarm": "What to do with an alarm",
    "time-and-memory": "Time and memory",
    "cite": "Cite",
    "glossary": "Glossary",
}
MOST_WORDS = 350
DECELERATIONS = (3.0, 7.0, 1.0)
"""Of the columns of the table of stopping distances, m/s²."""


def page(name):
    return read(GUIDE / f"{name}.md")


def cells(text):
    """Rows of all tables of a page, as cells."""
    lines = FENCE.sub("", text).splitlines()
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in lines
        if line.startswith("|") and not line.startswith("|--")
    ]


@pytest.mark.parametrize(("name", "title"), ANSWERS.items())
def test_an_answer_is_short_and_stands_first(name, title):
    head, first, *_ = page(name).split("\n\n")
    assert head == f"# {title}"
    assert first.startswith(("**", "| word"))
    assert len(page(name).split()) <= MOST_WORDS


def test_the_first_page_leads_to_every_answer_by_its_title():
    first = read(ROOT / "docs" / "index.md")
    for name, title in ANSWERS.items():
        assert f"[{title}](guide/{name}.md)" in first


def test_stopping_distances_are_those_of_the_vehicle():
    rows = [row for row in cells(page("how-fast")) if row[0].isdigit()]
    assert len(rows) == 4
    for speed, *distances in rows:
        for told, deceleration in zip(distances, DECELERATIONS, strict=True):
            vehicle = Vehicle(speed=float(speed) / 3.6, deceleration=deceleration)
            assert told == f"{vehicle.stopping_distance:.1f}"


def test_the_speed_that_a_distance_allows_stops_at_it():
    assert "v = a·(√(t² + 2d/a) − t)" in page("how-fast")
    distance, reaction, deceleration = 12.6, 1.5, 3.0
    speed = deceleration * ((reaction**2 + 2 * distance / deceleration) ** 0.5 - reaction)
    vehicle = Vehicle(speed=speed, reaction=reaction, deceleration=deceleration)
    assert vehicle.stopping_distance == pytest.approx(distance)


def test_questions_of_signs_are_named_as_the_program_names_them():
    first_cells = [row[0] for row in cells(page("is-my-sign-right"))[1:]]
    names = [name for cell in first_cells for name in re.findall(r"`([^`]+)`", cell)]
    assert names == list(QUESTIONS.values())


def test_mines_by_recipe_are_those_that_the_program_suggests_by():
    table = evidence()
    found = table["found"]["fused"]["prepared"], table["tracks"]["prepared"]["of"]
    text = " ".join(page("which-recipe").split())
    assert (
        "`fused` finds {} of {} mines where C_HH finds {} (p = {:g})".format(
            *found, table["found"]["made"]["prepared"], table["p"]["fused"]["prepared"]
        )
        in text
    )
    for track in ("as-found", "full-wave"):
        assert f"(p = {table['p']['fused'][track]:g})" in text


@pytest.mark.parametrize(("name", "column"), [("which-recipe", 1), ("cite", 0)])
def test_recipes_that_an_answer_names_are_packaged(name, column):
    of_column = " ".join(row[column] for row in cells(page(name)))
    named = set(re.findall(r"`([a-z]+\d*(?:-[a-z0-9]+)*)`", of_column)) - {"sri-array"}
    assert len(named) >= 3
    assert named <= set(recipe_names())


def test_the_software_is_cited_by_its_version():
    cited = yaml.safe_load(read(ROOT / "CITATION.cff"))
    assert f"version = {{{cited['version']}}}" in page("cite")
    assert f"{{{cited['title']}}}" in page("cite")
    assert cited["references"][1]["doi"] in page("cite")

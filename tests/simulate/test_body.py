"""Bodies: rules of their files, and what a target takes from them."""

import pytest
from pydantic import ValidationError

from flgpr.simulate.bodies.signature import load_body, packaged_bodies, packaged_table
from flgpr.simulate.bodies.signature.table import find_table
from flgpr.simulate.scene.scene import Target


@pytest.mark.parametrize("name", packaged_bodies())
def test_every_packaged_body_says_where_it_is_from_and_has_a_table(name):
    body = load_body(name)
    assert body.name == name
    assert body.source
    assert packaged_table(name).body == body


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('name = "a"\n[[layers]]\nthickness = 2.0\nzones = [[0.1, 3.0]]', r"layers.*thickness"),
        (
            'name = "a"\n[[layers]]\nthickness = 0.1\nzones = [[0.1, 3.0], [0.05, 2.0]]',
            "each wider than the one before",
        ),
        ('name = "a"\n[[layers]]\nthickness = 0.1\nzones = [[0.1, 0.5]]', "zones"),
        ('name = "a"\nlayers = []', "layers"),
        ('name = "a"\ncolour = "red"\n[[layers]]\nthickness = 0.1\nzones = [[0.1, 3.0]]', "colour"),
        ('name = "a', "not valid TOML"),
    ],
)
def test_a_body_that_breaks_a_rule_is_told_by_its_entry(tmp_path, text, message):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"wrong\.toml.*{message}"):
        load_body(path)


def test_an_unknown_body_is_told_what_there_is():
    with pytest.raises(ValueError, match=r"did you mean tm-62[mp]"):
        load_body("tm-62")
    with pytest.raises(ValueError, match=r"body file not found: no/such.toml"):
        load_body("no/such.toml")
    with pytest.raises(ValueError, match=r"did you mean tm-62[mp]"):
        find_table("tm-62")
    with pytest.raises(ValidationError, match=r"did you mean tm-62[mp]"):
        Target(kind="mine", x=0, y=10, body="tm-62")


def test_a_body_brings_its_size_and_takes_no_other():
    body = load_body("vs-1.6")
    target = Target(kind="plastic", x=0, y=10, depth=0.05, body="vs-1.6")
    assert (target.radius, target.height) == (body.radius, pytest.approx(body.height))
    assert Target.model_validate(target.model_dump(exclude_unset=True)) == target
    with pytest.raises(ValidationError, match=r"radius must not be given with body = 'vs-1.6'"):
        Target(kind="plastic", x=0, y=10, body="vs-1.6", radius=0.3)
    with pytest.raises(ValidationError, match="gap must not be given with body"):
        Target(kind="plastic", x=0, y=10, body="vs-1.6", gap=0.01)
    assert Target(kind="plastic", x=0, y=10, body="m19").radius == pytest.approx(0.166)

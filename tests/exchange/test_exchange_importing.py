"""Lines of commercial radars by options."""

import pytest

from flgpr_exchange.commands.importing import LinePositions, import_lines


@pytest.mark.parametrize(
    ("positions", "rule"),
    [
        (LinePositions(zigzag=True), "zigzag goes with line-spacing, got none"),
        (LinePositions(line_spacing=0.5, lines="lines.csv"), "where lines lie: give one"),
        (LinePositions(anchor="a.toml", anchor_from_track=True), "where lines lie: give one"),
    ],
)
def test_positions_of_lines_have_one_source(positions, rule, tmp_path):
    with pytest.raises(ValueError, match=rule):
        import_lines(["line.dt1"], tmp_path / "a.zarr", positions, 10**9, {})
    assert not list(tmp_path.iterdir())

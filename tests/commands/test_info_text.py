"""The text about runs and models: recipes that fit, the map of looks, and texts of strangers."""

from flgpr.commands.info import info_lines, model_lines

REPORT = {
    "title": "lane",
    "source": "simulated",
    "scans": 3,
    "travelled_m": 4.0,
    "scan_spacing_m": [1.5, 2.5],
    "pairs": 36,
    "polarizations": ["HH", "VV"],
    "missing_sweeps": 0,
    "masked_scans": [],
    "tones": 64,
    "frequency_hz": [0.5e9, 2.5e9],
    "uniform_tones": False,
    "largest_step_hz": 40e6,
    "unambiguous_path_m": 12.0,
    "range_resolution_m": 0.075,
    "pose": [[0, 0, 0.0], [0, 2, 0.5], [0, 4, 1.0]],
    "height_m": 2.0,
    "array_m": [3.0, 0.5, 0.0],
    "tx_m": [[0, 0, 2]],
    "rx_m": [[0, 0, 2], [1, 0, 2]],
    "lane": {"x": [-2.0, 2.0], "y": [0.0, 10.0]},
    "looks": {"mean": 1.5, "most": 4, "unseen_share": 0.25},
    "looks_map": [[0, 1], [4, 2]],
    "health": ["all 72 channels are alive"],
    "recipes": {"wang2007": [], "fuse2018": ["needs VH", "needs HV"]},
    "import_notes": ["time zero assumed"],
    "warnings": ["antennas lie far apart"],
}


def test_a_run_is_described_line_by_line():
    text = "\n".join(info_lines(REPORT))
    assert text.startswith("lane (simulated)\n  scans          3 over 4.00 m of travel, 1.50 to")
    assert "36 pairs x HH, VV: none missing" in text
    assert "from 0.5 to 2.5 GHz, uneven, up to 40 MHz apart" in text
    assert "1 transmitter and 2 receiver positions" in text
    assert "1.50 to 2.50 m above the ground" in text
    assert "1.5 looks on average, at most 4, 25 % never seen" in text
    assert "  note           time zero assumed" in text
    assert "  warning        antennas lie far apart" in text


def test_recipes_that_do_not_fit_have_a_line_for_each_fault():
    lines = info_lines(REPORT)
    first = lines.index("  recipe         wang2007 fits")
    assert lines[first + 1 : first + 4] == [
        "                 fuse2018: needs VH",
        "                 fuse2018: needs HV",
        "                 `flgpr recipe for RUN` makes one that fits",
    ]


def test_the_map_shows_one_look_as_more_than_none_and_far_rows_first():
    *_, far, near, legend = info_lines(REPORT)
    assert far == "  y    10.0 m  ██▒▒"
    assert near == "  y     0.0 m    ░░"
    assert legend.endswith("looks: blank 0 … █ 4")


def test_an_airborne_array_has_no_coverage_ahead():
    text = "\n".join(info_lines(REPORT | {"height_m": 500.0}))
    assert "coverage" not in text
    assert "looks" not in text


def test_texts_of_a_model_hide_no_character_and_are_cut_off():
    report = {
        "path": "model",
        "format": "flgpr-model",
        "version": 1,
        "flgpr": "1\x1b[2J",
        "arrays": [{"name": "weights", "dtype": "<f8", "shape": [3, 4]}],
        "bytes": 96,
        "detector": {"estimator": "FisherDiscriminant", "classes": "x" * 500},
        "stages": [],
        "notes": {"by": "nobody"},
    }
    lines = model_lines(report)
    assert "\\u001b[2J" in lines[0]
    assert "\x1b" not in "".join(lines)
    assert max(len(line) for line in lines) < 130
    assert lines[-1] == '  array          "weights" "<f8" [3, 4]'

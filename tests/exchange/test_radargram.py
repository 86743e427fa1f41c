"""A radargram of a recording, by command and from Python, without an import."""

import json

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.radargram import RadargramView, make_radargram
from flgpr.formats import read_gpr
from flgpr.report.images import radargram_figure
from flgpr_exchange.commands.imports import import_gpr
from flgpr_exchange.gpr.files import READERS
from io_gpr import (
    INTERVAL,
    ZERO,
    section,
    write_dt1,
    write_dzt,
    write_ids,
    write_impulse,
    write_mala,
    write_segy,
)
from io_open import write_ogpr, write_su

COUNTS = section(30)
WRITERS = {
    "a.DZT": lambda path: write_dzt(path, COUNTS[:, None]),
    "a.dt1": lambda path: write_dt1(path, COUNTS),
    "a.rd3": lambda path: write_mala(path, COUNTS),
    "a.iprb": lambda path: write_impulse(path, COUNTS),
    "a.sgy": lambda path: write_segy(path, COUNTS),
    "a.seg": lambda path: write_segy(path, COUNTS),
    "a.dt": lambda path: write_ids(path, COUNTS),
    "a.rd7": lambda path: write_mala(path, COUNTS),
    "a.segy": lambda path: write_segy(path, COUNTS, code=5),
    "a.su": lambda path: write_su(path, COUNTS),
    "a.ogpr": lambda path: write_ogpr(path, COUNTS[:, None]),
}


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def loaded(path):
    with np.load(path) as archive:
        return dict(archive)


def test_every_format_that_is_read_is_drawn():
    assert {name[1:].lower() for name in WRITERS} == set(READERS)


@pytest.mark.parametrize("name", WRITERS)
def test_one_command_draws_the_traces_of_every_format(name, tmp_path):
    WRITERS[name](tmp_path / name)
    done = run("image", tmp_path / name, "-o", tmp_path / "a.png", "-o", tmp_path / "a.npz")
    assert done.exit_code == 0, done.output
    made = loaded(tmp_path / "a.npz")
    recorded = read_gpr(tmp_path / name)
    np.testing.assert_array_equal(
        made["values"], recorded.traces[:, 0]
    )  # every count as the reader gives it
    np.testing.assert_array_equal(made["delay_s"], recorded.delay)
    for note in recorded.history:  # what was assumed is on the screen and in the file
        assert f"note: {note}" in done.output
        assert note in made["notes"]
    assert imread(tmp_path / "a.png").std() > 0.05


def test_steps_are_taken_in_their_order_and_told(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS + 500)
    done = run(
        "image", path, "-o", tmp_path / "a.npz", "--gain", "--background", "--dewow", "--json"
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert told["steps"] == [
        "dewow over 21 samples", "mean trace removed", "gain: divided by the line's level over 21 samples",
    ]  # fmt: skip
    assert told["unit"] == "amplitude over the line's level at that time"
    assert "window of dewow and gain assumed: 2 periods of the antenna's 500 MHz" in told["notes"]
    made = loaded(tmp_path / "a.npz")
    np.testing.assert_allclose(made["values"].mean(axis=0), 0, atol=1e-9)
    assert made["steps"].tolist() == told["steps"]


def test_a_window_without_an_antenna_is_a_tenth_of_the_record_and_a_given_one_is_taken(tmp_path):
    path = write_dzt(tmp_path / "a.DZT", COUNTS[:, None], names=("unnamed",))
    made = make_radargram(path, RadargramView(dewow=True))
    assert made.steps == ("dewow over 27 samples",)
    assert made.notes[-1].startswith("window of dewow and gain assumed: 10 % of the record")
    made = make_radargram(path, RadargramView(dewow=True, window=41 * INTERVAL))
    assert made.steps == ("dewow over 41 samples",)
    assert not any("assumed" in note for note in made.notes)


def test_a_part_of_the_line_and_of_the_time_and_another_channel(tmp_path):
    both = np.stack([COUNTS, -COUNTS], axis=1)
    path = write_dzt(tmp_path / "a.DZT", both, names=("50400", "50400"))
    done = run(
        "image", path, "-o", tmp_path / "a.npz", "--scans", 5, 9, "--until", 20, "--channel", 1
    )
    assert done.exit_code == 0, done.output
    made = loaded(tmp_path / "a.npz")
    samples = ZERO + int(20e-9 / INTERVAL) + 1
    np.testing.assert_array_equal(made["values"], read_gpr(path).traces[5:10, 1, :samples])
    assert made["trace"].tolist() == [5, 6, 7, 8, 9]
    assert "channel 1" in done.output


def test_depth_is_half_the_way_at_the_grounds_speed(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    made = make_radargram(path, RadargramView(permittivity=9.0))
    depth = made.depth()
    np.testing.assert_allclose(depth, made.delay * 299792458 / 3 / 2)
    figure = drawn(made)
    assert [axis.get_ylabel() for axis in figure.axes[0].child_axes] == ["depth (m)"]
    assert make_radargram(path).depth() is None


def drawn(made):
    parts = (made.number, made.distance, made.depth(), made.title, made.unit, made.steps)
    return radargram_figure(made.values, made.delay, *parts)


def test_a_picture_is_called_by_its_file_and_tells_what_its_grey_scale_leaves_out(tmp_path):
    made = make_radargram(write_mala(tmp_path / "a.rd3", COUNTS, SITE="meadow"))
    assert made.title == "meadow (a.rd3)"
    assert make_radargram(write_dt1(tmp_path / "b.dt1", COUNTS)).title == "b.dt1"
    bar = drawn(made).axes[-1]
    assert bar._colorbar.extend == "both"
    level = make_radargram(write_dt1(tmp_path / "c.dt1", np.sign(COUNTS) * 7))
    assert drawn(level).axes[-1]._colorbar.extend == "neither"


def test_the_axis_below_is_the_distance_where_it_is_even_and_the_trace_where_not(tmp_path):
    made = make_radargram(write_dt1(tmp_path / "a.dt1", COUNTS))
    axes = drawn(made).axes[0]
    assert axes.get_xlabel() == "distance along the line (m)"
    np.testing.assert_allclose(axes.get_xlim(), (-0.025, 29 * 0.05 + 0.025))
    np.testing.assert_allclose(
        axes.get_ylim()[1] * 1e-9, made.delay[0] - INTERVAL / 2
    )  # time runs downwards
    uneven = np.cumsum(np.linspace(0.01, 0.2, 30))
    figure = radargram_figure(made.values, made.delay, made.number, uneven, None, "a", "counts", ())
    axes = figure.axes[0]
    assert axes.get_xlabel() == "trace"
    above = axes.child_axes[0]
    assert above.get_xlabel() == "distance along the line (m), uneven"
    labels = [float(label.get_text()) for label in above.get_xticklabels()]
    np.testing.assert_allclose(labels, uneven[above.get_xticks().astype(int)], rtol=1e-3)


def test_a_trace_without_data_is_told_and_left_blank(tmp_path):
    made = make_radargram(write_dt1(tmp_path / "a.dt1", COUNTS, dead=4), RadargramView(gain=True))
    assert np.isnan(made.values[4]).all()
    assert "1 of 30 traces hold no data and are left blank" in made.notes


@pytest.mark.parametrize(
    ("words", "rule"),
    [
        (["--channel", 3], "channel must be from 0 to 0, got 3"),
        (["--scans", 3, 400], "scans must have 0 <= first <= last < 30"),
        (["--until", -90], "until must be a time after the first two samples"),
        (["--permittivity", 0.5], "permittivity must be from 1 to 100, got 0.5"),
        (
            ["--dewow", "--step-window", 900],
            "window must be from 0 to the record's 51.2 ns, got 900 ns",
        ),
        (["--x", 0, 1], "x: a recording is drawn as it is; to focus it, import it first"),
    ],
)
def test_what_does_not_fit_is_refused(words, rule, tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    done = run("image", path, "-o", tmp_path / "a.png", *words)
    assert done.exit_code == 2
    assert rule in done.output
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("name", "content", "rule"),
    [
        ("a.gpr", b"what", "a run or a recording (.dt1, .dzt, .rd3"),
        ("a.npz", b"PK", "flgpr info describes how arrays are imported"),
        (
            "a.mcap",
            b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"a" * 64 + b"\nsize 12\n",
            "is a pointer of Git LFS to a file of 12 bytes",
        ),
    ],
)
def test_a_file_that_cannot_be_drawn_is_told_what_can(name, content, rule, tmp_path):
    (tmp_path / name).write_bytes(content)
    done = run("image", tmp_path / name, "-o", tmp_path / "a.png")
    assert done.exit_code == 2
    assert rule in done.output


def test_another_ending_and_steps_on_a_run_are_refused(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    done = run("image", path, "-o", tmp_path / "a.tif")
    assert done.exit_code == 2
    assert "output of a recording must end in .png, .npz" in done.output
    import_gpr(path, tmp_path / "a.zarr")
    done = run(
        "image", tmp_path / "a.zarr", "-o", tmp_path / "b.png", "--dewow", "--permittivity", 9
    )
    assert done.exit_code == 2
    assert (
        "dewow: these are for recordings; of a run, `flgpr prepare` takes the steps" in done.output
    )

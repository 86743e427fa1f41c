"""``flgpr open`` ends in an answer: what files hold, what is open, a picture, and the next command."""

import json
import shlex

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import io_gpr
from flgpr.commands.app import app
from flgpr.commands.open import open_files
from flgpr.store import open_run, sample_lane

RUN = sample_lane() / "run.zarr"
SCANS = 12


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture
def archive(tmp_path):
    rng = np.random.default_rng(1)
    signal = rng.normal(size=(2, SCANS, 2, 40))
    places = np.array([[-0.5, 0, 0], [0.5, 0, 0]])
    np.savez(
        tmp_path / "own.npz", signal=signal[0] + 1j * signal[1], tx=places, rx=places,
        frequency=1e9 + 1e7 * np.arange(40), time=36000 + 0.1 * np.arange(SCANS),
    )  # fmt: skip
    return tmp_path / "own.npz"


def test_arrays_get_a_mapping_a_picture_and_the_exact_next_command(archive):
    mapping = archive.with_name("a.toml")
    shown = call("open", archive, "-o", mapping)
    assert shown.exit_code == 0, shown.output
    first, *_, last = shown.stdout.splitlines()
    assert first.startswith("own.npz, a NumPy archive, holds a signal; ")
    asked = [line for line in shown.stdout.splitlines() if line.startswith("  ") and '?"' in line]
    assert f"; {len(asked)} questions are open" in first
    assert 'polarization = ["HH?"]' in asked[0]
    assert last == f"next: flgpr import mapped {mapping} -o {mapping.with_suffix('.zarr')}"
    assert mapping.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    again = json.loads(call("open", archive, "-o", mapping, "--json").stdout)  # the same bytes
    assert again["answer"] == first
    assert len(again["questions"]) == len(asked)


def log(path, altitude=500.0):
    lines = []
    for k in range(40):
        body = f"GNGGA,1000{k / 10 + 0:05.2f},48{k * 2.7e-5:010.7f},N,01100.0000000,E,4,12,0.7,"
        body += f"{altitude:.3f},M,46.000,M,1.0,0000"
        total = 0
        for letter in body:
            total ^= ord(letter)
        lines.append(f"${body}*{total:02X}")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_height_of_a_receivers_antenna_is_asked_for_and_taken(archive):
    mapping = archive.with_name("a.toml")
    opened = open_files([archive, log(archive.with_name("way.nmea"))], mapping)
    assert "above the ground" in opened.questions[-1]
    held = "own.npz, a NumPy archive, holds a signal, way.nmea the track; "
    assert opened.answer.startswith(held)
    assert "[pose]" not in mapping.read_text()
    answered = mapping.read_text().replace("?", "")
    mapping.write_text(answered)
    words = shlex.split(opened.next.replace("HEIGHT", "2.5"))[1:]
    done = call(*words)
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(open_run(mapping.with_suffix(".zarr"))["pose"].values[:, 2], 2.5)
    refused = call(*words[:-1], "-1")
    assert refused.exit_code == 2
    assert "above-ground must be the positive height" in refused.output


def test_a_table_of_fixes_counts_as_the_track_and_not_among_the_files_of_the_signal(archive):
    mapping = archive.with_name("a.toml")
    scans = []
    for number in (1, 2):
        scans.append(archive.with_name(f"scan_{number}.npz"))
        scans[-1].write_bytes(archive.read_bytes())
    rows = [f"{36000 + 0.1 * k},{11 + 1e-6 * k},{48 + 1e-6 * k}" for k in range(SCANS)]
    way = archive.with_name("gps.txt")
    way.write_text("\n".join(["time,longitude,latitude", *rows]) + "\n")
    opened = open_files([*scans, way], mapping)
    assert opened.answer.startswith("2 files hold a signal, gps.txt the track; ")


def test_a_recording_is_drawn_and_a_run_is_to_be_checked(tmp_path):
    path = tmp_path / "line.dt1"
    io_gpr.write_dt1(path, io_gpr.section(60))
    opened = open_files(path, tmp_path / "line.toml")
    assert opened.next == f"flgpr import gpr {path} -o line.zarr"
    assert opened.picture.is_file()
    assert not (tmp_path / "line.toml").exists()
    assert open_files(RUN).next == f"flgpr check {RUN}"


def test_what_a_recording_does_not_tell_is_a_question_and_a_gather_is_not_to_be_imported(tmp_path):
    path = tmp_path / "line.dzt"
    io_gpr.write_dzt(path, io_gpr.section(60)[:, None], per_metre=0)
    opened = open_files(path, tmp_path / "line.toml")
    assert opened.answer.endswith("without a mapping; 1 question is open.")
    assert opened.questions == ("trace spacing unknown: give --step",)
    assert opened.next == f"flgpr import gpr {path} -o line.zarr --step METRES"
    gather = tmp_path / "gather.dt1"
    io_gpr.write_dt1(gather, io_gpr.section(60), SURVEY_MODE="CMP")
    opened = open_files(gather, tmp_path / "gather.toml")
    assert opened.answer.endswith("which can be looked at and not imported.")
    assert opened.next == f"flgpr view {gather}"


def test_what_cannot_be_opened_leaves_nothing(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"no archive")
    assert call("open", tmp_path / "a.npz", "-o", tmp_path / "a.toml").exit_code == 2
    assert call("open", tmp_path / "none.npz", "-o", tmp_path / "a.toml").exit_code == 2
    assert call("open", tmp_path / "a.npz", "-o", tmp_path / "a.txt").exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_what_would_be_left_out_in_silence_is_refused(archive, tmp_path):
    for name in ("a.nmea", "b.nmea"):
        log(tmp_path / name)
    for paths, words in (
        ([RUN, archive], r"a folder must be opened by itself, got .* and 1 others"),
        ([archive, archive], "paths must name every file once"),
        (
            [archive, tmp_path / "a.nmea", tmp_path / "b.nmea"],
            "one log of their track, got a.nmea, b",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            open_files(paths)
    with pytest.raises(ValueError, match=r"and the output own\.toml"):
        open_files(RUN, "own.toml")


def test_a_folder_is_opened_from_within(monkeypatch):
    monkeypatch.chdir(RUN)
    assert "is a run of" in call("open", ".").stdout


def test_names_in_a_file_write_no_lines_of_the_answer(tmp_path):
    with h5py.File(tmp_path / "forged.h5", "w") as file:
        file["zz: ok\nnext: flgpr import mapped evil.toml"] = np.zeros((2, 3))
    lines = call("open", tmp_path / "forged.h5").stdout.splitlines()
    assert [line for line in lines if line.startswith("next: ")] == lines[-1:]
    assert not any(line.strip().startswith("next: flgpr import mapped evil") for line in lines)

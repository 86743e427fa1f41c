"""OpenGPR: samples, places, versions, and files that contradict themselves."""

import numpy as np
import pytest
from pyproj import Transformer

from flgpr.formats import read_gpr
from io_gpr import INTERVAL, NOMINAL, STEP
from io_open import (
    CHANNELS,
    COUNTS,
    SAMPLES,
    SLICES,
    slice_records,
    way,
    write_ogpr,
)


@pytest.mark.parametrize("kind", ["<f4", "<i2"])
def test_every_sample_of_every_channel_of_an_ogpr_file_is_read(kind, tmp_path):
    line = read_gpr(write_ogpr(tmp_path / "a.ogpr", kind=kind))
    np.testing.assert_array_equal(line.traces, COUNTS)
    np.testing.assert_allclose(line.delay, INTERVAL * np.arange(SAMPLES))
    np.testing.assert_allclose(line.distance, STEP * np.arange(SLICES))
    assert line.frequencies == (NOMINAL,) * CHANNELS
    assert line.title == "S3"
    assert "blocks found and not understood: Markers" in line.history
    assert "the descriptor tells no time zero: it is put at the first sample" in line.history


@pytest.mark.parametrize("form", ["every sample", "every trace", "every slice", "records"])
def test_places_of_an_ogpr_file_give_distances_and_fixes(form, tmp_path):
    per_slice = way()
    places = {
        "every slice": per_slice,
        "every trace": np.repeat(per_slice[:, None], CHANNELS, axis=1),
        "every sample": np.broadcast_to(per_slice[:, None, None], (SLICES, CHANNELS, SAMPLES, 3)),
        "records": slice_records(np.repeat(per_slice[:, None], CHANNELS, axis=1)),
    }[form]
    line = read_gpr(write_ogpr(tmp_path / "a.ogpr", places=places))
    np.testing.assert_allclose(line.distance, 0.5 * np.arange(SLICES), atol=1e-6)
    lon, lat = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True).transform(
        *per_slice[:, :2].T
    )
    np.testing.assert_allclose(line.fixes[:, 1:3], np.stack([lon, lat], axis=-1), atol=1e-9)
    np.testing.assert_array_equal(line.fixes[:, 3], per_slice[:, 2])
    assert "heights are taken as ellipsoidal: EPSG:32632 does not tell" in line.history


def test_places_that_are_not_understood_are_told(tmp_path):
    line = read_gpr(write_ogpr(tmp_path / "a.ogpr", places=np.ones((SLICES, 7))))
    assert any("found, not understood: positions are not read" in note for note in line.history)
    assert "traces are put at equal steps of 0.05 m, by samplingStep_m" in line.history
    line = read_gpr(write_ogpr(tmp_path / "a.ogpr", places=way(), srs=None))
    assert (
        "Sample Geolocations name no reference system: they give the distance alone" in line.history
    )
    assert len(line.fixes) == 0
    line = read_gpr(write_ogpr(tmp_path / "a.ogpr", places=np.ones((SLICES, 3))))
    assert any("all at one place: positions are not read" in note for note in line.history)


@pytest.mark.parametrize("version", [{"major": 1, "minor": 0}, {"major": 2, "minor": 1}])
def test_versions_that_are_known_are_read_without_a_word(version, tmp_path):
    assert not notes_on_version(read_gpr(write_ogpr(tmp_path / "a.ogpr", version=version)))


@pytest.mark.parametrize(
    ("version", "told"), [({"major": 3, "minor": 0}, "'3'"), ("draft", "'draft'"), ({"a": 1}, "a")]
)
def test_a_version_that_is_not_known_is_told(version, told, tmp_path):
    (note,) = notes_on_version(read_gpr(write_ogpr(tmp_path / "a.ogpr", version=version)))
    assert told in note
    assert note.endswith("which is not known: it is read as version 2")


def notes_on_version(line):
    return [note for note in line.history if note.startswith("its version is")]


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"samplesCount": 65}, "block Radar Volume must hold 12 x 3 x 65 samples of 2 or 4 bytes"),
        ({"samplesCount": "64"}, "samplesCount must be a whole number from 2"),
        ({"channelsCount": 0}, "channelsCount must be a whole number from 1 to 256, got 0"),
        ({"slicesCount": 2**40}, "slicesCount must be a whole number"),
    ],
)
def test_an_ogpr_file_that_contradicts_itself_is_refused(changes, rule, tmp_path):
    with pytest.raises(ValueError, match=f"a.ogpr: cannot be read as OpenGPR: .*{rule}"):
        read_gpr(write_ogpr(tmp_path / "a.ogpr", **changes))


def test_a_cut_or_foreign_ogpr_file_is_refused(tmp_path):
    path = write_ogpr(tmp_path / "a.ogpr")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ValueError, match="block Radar Volume must end within the file's"):
        read_gpr(path)
    path.write_bytes(b"ogpr\n" + b"[" * 5000)
    with pytest.raises(ValueError, match="its descriptor must"):
        read_gpr(path)
    path.write_bytes(b"PK" * 40)
    with pytest.raises(ValueError, match="it must begin with the line ogpr"):
        read_gpr(path)

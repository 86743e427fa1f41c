"""The XML tree of a run as CPHD, by the elements of the standard."""

import json

import numpy as np
import pytest

from flgpr.geo.anchor import fit_anchor
from flgpr.model import Grid
from flgpr_exchange.cphd.tree import ADDED, metadata_tree
from io_geodesy import LANE, on_the_ellipsoid

pytest.importorskip("sarkit")
etree = pytest.importorskip("lxml.etree")
# The library reads its own schemas in a way that Python deprecates.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

NAMES = ["0_HH", "1_HH", "0_VV", "1_VV"]
SCENE = Grid.spanning((-2.0, 2.0), (3.0, 9.0), 0.1)


@pytest.fixture(scope="module")
def anchor():
    return fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [300.0] * 4)


def vectors_of(scans):
    """Make vectors of a reference point that is 30 m from the transmitter and 60 m from the receiver."""
    point = np.tile([6.4e6, 0.0, 0.0], (scans, 1))
    return {
        "TxPos": point + [30.0, 0.0, 0.0],
        "RcvPos": point + [0.0, 60.0, 0.0],
        "SRPPos": point,
        "TxTime": np.arange(scans, dtype=float),
        "RcvTime": np.arange(scans) + 3e-7,
        "FX1": np.full(scans, 1e9),
        "FX2": np.full(scans, 3e9),
        "TOA1": np.full(scans, -5e-8),
        "TOA2": np.full(scans, 5e-8),
        "SIGNAL": np.ones(scans, np.int64),
        **dict.fromkeys(ADDED, np.zeros(scans)),
    }


@pytest.fixture
def tree(small_run, anchor):
    small_run.attrs["title"] = "lane <1>"
    small_run["valid"][1, 0, 1] = False
    vectors = {name: vectors_of(4) for name in NAMES}
    return metadata_tree(small_run, vectors, anchor, SCENE)


def texts(tree, path):
    return [element.text for element in tree.findall(path, {"": tree.getroot().nsmap[None]})]


def test_titles_are_text_and_the_band_is_that_of_the_first_channel(tree):
    assert texts(tree, "CollectionID/CoreName") == ["lane <1>"]
    assert b"lane &lt;1&gt;" in etree.tostring(tree)
    assert [float(text) for text in texts(tree, "Global/FxBand/*")] == [1e9, 3e9]
    assert [float(text) for text in texts(tree, "Global/TOASwath/*")] == [-5e-8, 5e-8]


def test_channels_lie_one_after_the_other(tree):
    assert texts(tree, "Data/Channel/Identifier") == NAMES
    size = int(texts(tree, "Data/NumBytesPVP")[0])
    signals = [int(text) for text in texts(tree, "Data/Channel/SignalArrayByteOffset")]
    vectors = [int(text) for text in texts(tree, "Data/Channel/PVPArrayByteOffset")]
    assert signals == [4 * 5 * 8 * number for number in range(4)]
    assert vectors == [4 * size * number for number in range(4)]
    offsets = [int(text) for text in texts(tree, "PVP//Offset")]
    sizes = [int(text) for text in texts(tree, "PVP//Size")]
    order = np.argsort(offsets)
    np.testing.assert_array_equal(
        np.array(offsets)[order], np.cumsum([0, *np.array(sizes)[order][:-1]])
    )
    assert 8 * sum(sizes) == size


def test_a_channel_with_missing_sweeps_is_not_normal(tree):
    assert texts(tree, "Channel/Parameters/SignalNormal") == ["true", "false", "true", "true"]
    assert texts(tree, "Channel/Parameters/Polarization/TxPol") == ["H", "H", "V", "V"]


def test_the_point_is_seen_when_the_wave_is_there(tree):
    """It has gone a third of its way by then."""
    (middle,) = texts(tree, "Dwell/CODTime/CODTimePoly/Coef")
    (duration,) = texts(tree, "Dwell/DwellTime/DwellTimePoly/Coef")
    assert float(middle) == pytest.approx(1.5 + 1e-7, abs=1e-12)
    assert float(duration) == pytest.approx(3.0)


def test_the_scene_lies_about_its_centre(tree, anchor):
    longitude, latitude, _ = anchor.to_geodetic(np.array([0.0, 6.0, 0.0]))
    (lat,) = texts(tree, "SceneCoordinates/IARP/LLH/Lat")
    (lon,) = texts(tree, "SceneCoordinates/IARP/LLH/Lon")
    assert (float(lat), float(lon)) == pytest.approx((latitude, longitude), abs=1e-9)
    corners = texts(tree, "SceneCoordinates/ImageAreaCornerPoints/IACP/Lat")
    assert len(corners) == 4
    assert min(map(float, corners)) < latitude < max(map(float, corners))


def test_what_has_no_element_is_added_as_a_parameter(tree, small_run):
    elements = tree.findall("Channel/AddedParameters/Parameter", {"": tree.getroot().nsmap[None]})
    added = {element.get("name"): element.text for element in elements}
    assert json.loads(added["flgpr_frequency"]) == small_run["frequency"].values.tolist()
    assert json.loads(added["flgpr_attrs"])["title"] == "lane <1>"
    assert json.loads(added["flgpr_time"]) == [
        time if np.isfinite(time) else None for time in small_run["time"].values.tolist()
    ]

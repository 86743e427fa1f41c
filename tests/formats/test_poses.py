"""Entries of a mapping that say where the vehicle was, and rasters, joined files, interleaved samples."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flgpr.formats.axes import attitude_of
from flgpr.formats.mapped import import_mapped
from flgpr.formats.mapping import parse_mapping
from flgpr.geo.anchor import fit_anchor
from flgpr.model.frames import attitude_angles, attitude_matrix, heading_matrix
from flgpr.model.track import course
from io_geodesy import AZIMUTH, LANE, on_the_ellipsoid

TONES = 1e9 + 1e8 * np.arange(3)
ORIENTED = '[pose]\nposition = {variable = "pos", unit = "m"}\n'
HEAD = """
title = "made up"
polarization = ["HH"]
[signal]
variable = "data"
dims = ["scan", "frequency"]
[frequency]
variable = "f"
unit = "Hz"
"""
ANTENNA = '[antenna_position]\nvalues = [[0, 0, 0]]\nunit = "m"\n'
LEVEL = "heading = 90\npitch = 0\nroll = 0\nangle_unit = 'deg'\n"


def put(text, path):
    path.write_text(text, encoding="utf-8")
    return path


def arrived(tmp_path, tables, more=HEAD + ANTENNA, anchor=None, **arrays):
    scans = {"data": np.arange(15.0).reshape(5, 3) * (1 + 1j), "f": TONES} | arrays
    np.savez(tmp_path / "a.npz", **scans)
    return import_mapped(put(more + tables, tmp_path / "m.toml"), tmp_path / "a.npz", anchor=anchor)


def poses(tmp_path, tables, **arrays):
    return arrived(tmp_path, tables, **arrays).run["pose"].values


WAY = np.column_stack([np.linspace(0, 1, 5), 2.0 * np.arange(5), np.full(5, 1.5)])


@pytest.mark.parametrize(
    ("table", "pos"),
    [
        ('position = {variable = "pos", unit = "ft"}', WAY / 0.3048),
        ('position = {variable = "pos", unit = "cm"}', 100 * WAY.T),
        ('position = {variable = "pos", z = 1.5, unit = "m"}', WAY[:, :2]),
        ('x = {variable = "pos", column = 2}\ny = {variable = "pos", column = 0}\nz = 1.5\nunit = "m"', WAY[:, [1, 2, 0]]),  # noqa: E501
        ('position = {variable = "pos", unit = "m"}\naxes = ["x", "-z", "y"]', WAY[:, [0, 2, 1]] * [1, 1, -1]),
    ],
)  # fmt: skip
def test_positions_in_one_table(table, pos, tmp_path):
    got = poses(tmp_path, f"[pose]\n{table}\n{LEVEL}", pos=pos)
    np.testing.assert_allclose(
        got, np.column_stack([WAY, np.full(5, np.pi / 2), np.zeros((5, 2))]), atol=1e-12
    )


def test_six_columns_hold_the_angles_too(tmp_path):
    six = np.column_stack([WAY, np.linspace(0, 0.4, 5), np.full((5, 2), 0.01)])
    table = '[pose]\nposition = {variable = "pos", unit = "m"}\nangle_unit = "rad"\n'
    np.testing.assert_allclose(poses(tmp_path, table, pos=six), six)
    for text, shape in ((table, (5, 3)), (table + "heading = 0\npitch = 0\nroll = 0\n", (5, 6))):
        with pytest.raises(ValueError, match=r"a\.npz: pose\.position must have six columns"):
            poses(tmp_path, text, pos=six[:, : shape[1]])


def test_a_course_is_the_heading_of_poses(tmp_path):
    table = ORIENTED + LEVEL.replace("90", "'course'")
    np.testing.assert_allclose(poses(tmp_path, table, pos=WAY)[:, 3], np.arctan2(0.25, 2.0))


def slow_course(points, least=0.05):
    """For every point the nearest ones before and after that are far enough, looked at one by one."""
    heading = np.full(len(points), np.nan)
    for k, here in enumerate(points):
        later = next((p for p in points[k:] if np.hypot(*(p - here)) >= least), here)
        earlier = next((p for p in points[: k + 1][::-1] if np.hypot(*(p - here)) >= least), here)
        if np.hypot(*(later - earlier)) >= least:
            heading[k] = np.arctan2(*(later - earlier))
    known = np.isfinite(heading)
    return np.interp(np.arange(len(points)), np.flatnonzero(known), np.unwrap(heading[known]))


def test_a_course_with_stops_is_that_of_the_slow_twin():
    rng = np.random.default_rng(5)
    points = np.cumsum(
        rng.normal(0.03, 0.03, (300, 2)) * np.repeat(rng.integers(0, 2, 15), 20)[:, None], axis=0
    )
    np.testing.assert_allclose(
        np.exp(1j * course(points)), np.exp(1j * slow_course(points)), atol=1e-9
    )


RASTER = HEAD.replace('["scan", "frequency"]', '["frequency", "scan", "scan"]') + ANTENNA


@pytest.mark.parametrize("rows", [3, 2])
def test_a_raster_is_flattened_in_c_order(rows, tmp_path):
    data = np.arange(9.0 * rows).reshape(3, rows, 3) + 1j
    x = np.array([0.0, 10.0, 20.0])
    y = np.arange(1.0, rows + 1)
    table = (
        '[pose]\nx = {variable = "x", axis = 1}\ny = {variable = "y", axis = 0}\nz = "z"\nunit = "mm"\n'
        + LEVEL
    )
    height = np.arange(3.0 * rows).reshape(rows, 3)
    run = arrived(tmp_path, table, RASTER, data=data, x=x, y=y, z=height).run
    scan = 1 * 3 + 2  # row 1, column 2
    np.testing.assert_array_equal(
        run["signal"].values[scan, 0, 0], data[:, 1, 2].astype(np.complex64)
    )
    np.testing.assert_allclose(run["pose"].values[scan, :3], [0.020, 0.002, 0.005])
    plain = table.replace('{variable = "x", axis = 1}', '"x"').replace(
        '{variable = "y", axis = 0}', '"y"'
    )
    if rows == 3:
        with pytest.raises(ValueError, match=r"a\.npz: pose\.x fits scan axes .* axis"):
            arrived(tmp_path, plain, RASTER, data=data, x=x, y=y, z=height)
    else:
        assert arrived(tmp_path, plain, RASTER, data=data, x=x, y=y, z=height).run.identical(run)
        with pytest.raises(ValueError, match=r"pose\.z must have the shape \(2, 3\)"):
            arrived(tmp_path, plain, RASTER, data=data, x=x, y=y, z=height.T)
    grid = np.stack([*np.meshgrid(x, y), height], axis=-1)
    timed = table + '[time]\nvariable = "z"\nunit = "s"\n'
    np.testing.assert_array_equal(
        arrived(tmp_path, timed, RASTER, data=data, x=x, y=y, z=height).run["time"][scan], 5
    )
    whole = '[pose]\nposition = {variable = "p", unit = "mm"}\n' + LEVEL
    np.testing.assert_array_equal(
        arrived(tmp_path, whole, RASTER, data=data, p=grid).run["pose"], run["pose"]
    )


def test_numbers_and_columns_place_antennas(tmp_path):
    text = HEAD.replace('["scan", "frequency"]', '["scan", "pair", "frequency"]')
    text += '[antenna_position]\nx = {variable = "ant", column = 1}\ny = 0\nz = 0.3\nunit = "in"\n'
    data = np.ones((5, 2, 3), complex)
    table = ORIENTED + LEVEL
    run = arrived(
        tmp_path, table, text, data=data, ant=np.array([[9.0, -1.0], [9.0, 1.0]]), pos=WAY
    ).run
    np.testing.assert_allclose(run["tx_position"], 0.0254 * np.array([[-1, 0, 0.3], [1, 0, 0.3]]))
    single = arrived(
        tmp_path, table, HEAD + '[antenna_position]\nx = 0\ny = 0.1\nz = 0\nunit = "ft"\n', pos=WAY
    ).run
    np.testing.assert_allclose(single["rx_position"], [[0, 0.03048, 0]])


def test_positions_of_one_antenna_in_the_lane_frame(tmp_path):
    text = '[antenna_position]\nvariable = "pos"\nunit = "m"\nframe = "lane"\n'
    np.testing.assert_allclose(
        arrived(tmp_path, text, HEAD, pos=WAY).run["pose"].values[:, :3], WAY
    )


def test_interleaved_samples_in_a_flat_record(tmp_path):
    data = np.random.default_rng(1).integers(-99, 99, (5, 2, 3, 2)).astype(np.int16)
    text = HEAD.replace(
        'dims = ["scan", "frequency"]',
        'dims = ["scan", "pair", "frequency"]\ninterleaved = true\nshape = [-1, 2, 3]',
    )
    text += '[antenna_position]\nvalues = [[0, 0, 0], [1, 0, 0]]\nunit = "m"\n'
    table = ORIENTED + LEVEL
    run = arrived(tmp_path, table, text, data=data.reshape(5, 12), pos=WAY).run
    np.testing.assert_array_equal(run["signal"].values[:, 0], data[..., 0] + 1j * data[..., 1])
    with pytest.raises(ValueError, match=r"a\.npz: signal\.shape must hold"):
        arrived(tmp_path, table, text, data=data.reshape(5, 12)[:, :8], pos=WAY)
    with pytest.raises(ValueError, match=r"signal\.interleaved asks for pairs of real numbers"):
        arrived(tmp_path, table, text, data=data.reshape(5, 12)[:, :11], pos=WAY)


def test_axes_written_as_a_span(tmp_path):
    text = (
        HEAD.replace('variable = "f"', "span = [1.0, 1.2]").replace('unit = "Hz"', 'unit = "GHz"')
        + ANTENNA
    )
    table = ORIENTED + LEVEL + '[time]\nspan = [0, 8]\nunit = "s"\n'
    run = arrived(tmp_path, table, text, pos=WAY).run
    np.testing.assert_allclose(run["frequency"], TONES)
    np.testing.assert_allclose(run["time"], 2.0 * np.arange(5))


def test_files_of_a_scan_each_with_positions_elsewhere(tmp_path):
    data = np.random.default_rng(0).normal(size=(12, 3)) + 1j
    for k, scan in enumerate(data):
        np.save(
            tmp_path / f"scan_{k}.npy", scan
        )  # scan_10 must come after scan_9, not after scan_1
    np.savetxt(
        tmp_path / "where.csv", np.column_stack([np.arange(12.0), np.zeros((12, 2))]), delimiter=";"
    )
    text = HEAD.replace(
        '"made up"',
        '"made up"\njoin = "new scan"\nfiles = {data = "scan_*.npy", where = "where.csv"}',
    )
    text = text.replace('"data"\ndims = ["scan", ', '"array"\ndims = [').replace(
        'variable = "f"', "span = [1e9, 1.2e9]"
    )
    table = '[pose]\nposition = {file = "where", variable = "table", unit = "m"}\n' + LEVEL
    run = import_mapped(put(text + ANTENNA + table, tmp_path / "m.toml")).run
    np.testing.assert_array_equal(run["signal"].values[:, 0, 0], data.astype(np.complex64))
    np.testing.assert_array_equal(run["pose"].values[:, 0], np.arange(12.0))
    with pytest.raises(ValueError, match=r"signal.*12 files must hold at most"):
        import_mapped(tmp_path / "m.toml", limit=500)


TRACK = """
[time]
variable = "t"
unit = "s"
[track]
time = {variable = "clock", unit = "s"}
position = {variable = "fix", unit = "m"}
heading = "course"
pitch = 0
roll = 0
angle_unit = "deg"
clock_offset = 0.0
"""


def test_missing_fixes_are_bridged_and_counted(tmp_path):
    clock = np.arange(0, 10, 0.25)
    fix = np.column_stack([np.zeros(40), clock, np.ones(40)])
    time = np.array([1.0, 2.0, 3.1, 4.0, 8.0])
    whole = arrived(tmp_path, TRACK, t=time, clock=clock, fix=fix)
    fix[[0, 12, 13], 1] = np.nan
    mended = arrived(tmp_path, TRACK, t=time, clock=clock, fix=fix)
    assert "3 of 40 fixes of the track not finite, bridged" in mended.notes
    np.testing.assert_allclose(mended.run["pose"], whole.run["pose"], atol=1e-12)
    fix[13:18] = np.nan
    with pytest.raises(ValueError, match=r"no gap over 1 s, got 1\.75 s"):
        arrived(tmp_path, TRACK, t=time, clock=clock, fix=fix)
    with pytest.raises(ValueError, match=r"a\.npz: track.* two finite fixes, got 1 of 40"):
        arrived(
            tmp_path,
            TRACK,
            t=time,
            clock=clock,
            fix=np.where(np.arange(40)[:, None] == 3, fix, np.nan),
        )
    with pytest.raises(ValueError, match=r"a\.npz: track\.time must increase"):
        arrived(tmp_path, TRACK, t=time, clock=clock[::-1], fix=np.nan_to_num(fix))


def test_angles_undo_the_rotation():
    rng = np.random.default_rng(3)
    for heading, pitch, roll in rng.uniform([-3, -1.5, -3], [3, 1.5, 3], (20, 3)):
        turned = heading_matrix(heading) @ attitude_matrix(pitch, roll)
        np.testing.assert_allclose(attitude_angles(turned), [heading, pitch, roll], atol=1e-12)


def test_robots_quaternions_become_heading_pitch_and_roll():
    # x forward, y left, z up, in a world of x east, y north: yaw counts from east, anticlockwise.
    yaw = np.radians([90.0, 0.0, 45.0])
    quaternion = Rotation.from_euler("z", yaw[:, None]).as_quat()
    angles = attitude_of(quaternion, ("x", "y", "z"), ("-y", "x", "z"))
    np.testing.assert_allclose(
        angles, [[0, 0, 0], [np.pi / 2, 0, 0], [np.pi / 4, 0, 0]], atol=1e-12
    )
    # Nose up about the body's y, whose positive turn is nose down for x forward and z up.
    up = Rotation.from_euler("ZY", [[np.pi / 2, -0.1]]).as_quat()
    np.testing.assert_allclose(
        attitude_of(up, ("x", "y", "z"), ("-y", "x", "z")), [[0, 0.1, 0]], atol=1e-12
    )
    right = Rotation.from_euler(
        "ZX", [[np.pi / 2, 0.2]]
    ).as_quat()  # about the way forward: the left side goes up
    np.testing.assert_allclose(
        attitude_of(right, ("x", "y", "z"), ("-y", "x", "z")), [[0, 0, 0.2]], atol=1e-12
    )
    assert np.isnan(attitude_of(np.zeros((1, 4)), ("x", "y", "z"), ("x", "y", "z"))).all()


def test_orientations_in_a_mapping(tmp_path):
    angles = np.column_stack([np.linspace(-0.5, 0.5, 5), np.full(5, 0.1), np.full(5, -0.2)])
    turned = Rotation.from_matrix([heading_matrix(h) @ attitude_matrix(p, r) for h, p, r in angles])
    q = turned.as_quat()
    e = turned.as_euler("ZXY", degrees=True)
    body = 'body = ["x", "y", "z"]'
    for text in (
        f'orientation = {{variable = "q", {body}}}',
        f'orientation = {{x = "qx", y = "qy", z = "qz", w = "qw", {body}}}',
        f'orientation = {{variable = "e", euler = "ZXY", unit = "deg", {body}}}',
    ):
        parts = {f"q{name}": q[:, k] for k, name in enumerate("xyzw")}
        got = poses(tmp_path, ORIENTED + text + "\n", pos=WAY, q=q, e=e, **parts)
        np.testing.assert_allclose(got, np.column_stack([WAY, angles]), atol=1e-9)
    for text, words in (
        (f'orientation = {{variable = "e", {body}}}', "pose.orientation must have 4 columns"),
        (
            'orientation = {variable = "q", body = ["x", "y", "-z"]}',
            "pose.orientation.body must be .* right-handed",
        ),
        (
            f'orientation = {{variable = "e", euler = "ZxY", unit = "deg", {body}}}',
            "euler must be x, y and z",
        ),
        (
            f'orientation = {{variable = "q", {body}}}\naxes = ["up", "y", "z"]',
            "pose.axes must be three of",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            poses(tmp_path, ORIENTED + text + "\n", pos=WAY, q=q, e=e)


def test_longitude_and_latitude_need_the_anchor(tmp_path):
    anchor = fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02, [300.0] * 4)
    place = WAY * [1.0, 2.0, 1.0]
    longitude, latitude, height = anchor.to_geodetic(place).T
    north = np.degrees(AZIMUTH)
    table = (
        '[pose]\ngeodetic = {longitude = "lon", latitude = "lat", height = "h", angle_unit = "deg", unit = "m"}\n'
        f'heading = {north}\npitch = 0\nroll = 0\nangle_unit = "deg"\n'
    )
    arrays = {"lon": longitude, "lat": latitude, "h": height}
    got = arrived(tmp_path, table, anchor=anchor, **arrays).run["pose"].values
    np.testing.assert_allclose(got[:, :3], place, atol=1e-4)
    np.testing.assert_allclose(
        got[:, 3], anchor.azimuth - anchor.azimuth + np.radians(north) - anchor.azimuth, atol=1e-9
    )
    with pytest.raises(ValueError, match=r"pose\.geodetic needs an anchor"):
        arrived(tmp_path, table, **arrays)
    with pytest.raises(ValueError, match=r"a\.npz: pose\.geodetic must have latitudes"):
        arrived(tmp_path, table, anchor=anchor, **(arrays | {"lat": latitude + 90}))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            '[pose]\nx = 0\ny = 0\nz = 0\nunit = "m"\n' + LEVEL.replace("pitch = 0\n", ""),
            "pose: pitch is missing",
        ),
        ("[pose]\nx = 0\ny = 0\nz = 0\n" + LEVEL, "pose: unit is missing"),
        (
            '[pose]\nx = 0\nposition = {variable = "p", unit = "m"}\n' + LEVEL,
            "pose: give one of position",
        ),
        (ORIENTED + LEVEL.replace("angle_unit = 'deg'", ""), "pose: angle_unit is missing"),
        (
            ORIENTED + LEVEL + 'orientation = {variable = "q", body = ["x", "y", "z"]}\n',
            "either orientation",
        ),
        (ORIENTED + 'orientation = {variable = "q"}\n', "body: is missing"),
        (
            '[pose]\nx = {variable_ = "p"}\ny = 0\nz = 0\n' + LEVEL,
            r"pose\.x\.variable_: .*mean variable",
        ),
        (
            '[pose]\nposition = {variable = "p", x = 0, unit = "m"}\n' + LEVEL,
            "give one of: variable",
        ),
        (
            '[pose]\nx = "0?"\ny = 0\nz = 0\nunit = "m?"\n' + LEVEL,
            r"pose.x is still a guess, got '0\?' .*pose.unit",
        ),
    ],
)
def test_tables_that_contradict_themselves(table, words):
    with pytest.raises(ValueError, match=words):
        parse_mapping(HEAD + ANTENNA + table)


@pytest.mark.parametrize(
    ("table", "arrays", "words"),
    [
        (ORIENTED + "[time]\nvariable = 't'\nunit = 's'\n", {"pos": WAY, "t": WAY[:4, 0]}, "a.npz: time must have 5"),
        (ORIENTED, {"pos": WAY, "f": TONES * np.nan}, r"a\.npz: frequency must be finite"),
        (ORIENTED, {"pos": WAY, "data": np.full((5, 3), np.nan + 0j)}, r"a\.npz: signal must hold"),
        (ORIENTED, {"pos": WAY[:4]}, r"pose\.position must have 5 positions"),
        (ORIENTED, {"pos": WAY[:, :2]}, r"pose\.position must have x, y and z"),
        ('[pose]\nx = "pos"\ny = 0\nz = 0\nunit = "m"\n', {"pos": WAY[:4, 0]}, r"pose\.x must have 5 values"),
        ('[pose]\nx = "pos"\ny = 0\nz = 0\nunit = "m"\n', {"pos": WAY[:, 0] + 1j}, r"pose\.x must be real"),
        ('[pose]\nx = "pos"\ny = 0\nz = 0\nunit = "s"\n', {"pos": WAY[:, 0]}, r"pose\.unit must be one of m"),
        ('[pose]\nx = {variable = "pos", column = 7}\ny = 0\nz = 0\nunit = "m"\n', {"pos": WAY}, r"pose\.x\.column"),
        (ORIENTED, {"pos": WAY * np.nan}, r"pose\.x must be finite"),
    ],
)  # fmt: skip
def test_errors_name_the_entry_and_the_file(table, arrays, words, tmp_path):
    with pytest.raises(ValueError, match=words) as error:
        arrived(tmp_path, table.replace("[pose]\n", f"[pose]\n{LEVEL}"), **arrays)
    assert str(tmp_path) in str(error.value)

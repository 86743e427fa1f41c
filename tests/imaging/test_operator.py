import numba
import numpy as np
import pytest

from flgpr.imaging import ImagingOperator
from flgpr.imaging.cpu import DirectBackend, PreciseBackend, ProfileBackend
from flgpr.model import SPEED_OF_LIGHT

TONES = 500e6 + 10e6 * np.arange(128)
TX = np.tile([0.0, 0.0, 5.0], (6, 1))
RX = np.stack([np.linspace(-2, 2, 6), np.zeros(6), np.full(6, 5.0)], axis=1)
BANDS = ((0.5e9, 1.0e9), (0.9e9, 1.7e9))


def grid(nx=21, ny=33):
    x, y = np.meshgrid(np.linspace(-3, 3, nx), np.linspace(8, 15, ny))
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def noise(shape, seed=0):
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def test_a_scatterer_focuses_where_it_is():
    points = grid()
    truth = points[20, 7]
    length = np.linalg.norm(truth - TX, axis=1) + np.linalg.norm(truth - RX, axis=1)
    data = np.exp(-2j * np.pi * TONES * length[:, None] / SPEED_OF_LIGHT)
    image = ImagingOperator(TONES, TX, RX, points).adjoint(data[None])
    assert image.shape == (1, 1, 33, 21)
    assert image.dtype == np.complex64
    assert np.unravel_index(np.abs(image[0, 0]).argmax(), (33, 21)) == (20, 7)
    assert image[0, 0, 20, 7] == pytest.approx(6 * 128, rel=1e-3)


@pytest.mark.parametrize("kind", [{}, {"dtype": "complex128"}, {"half_space": 3.4}])
def test_results_do_not_depend_on_the_number_of_threads(kind):
    operator = ImagingOperator(TONES, TX, RX, grid() - [0, 0, 0.1], BANDS, method="profile", **kind)
    data = noise((3, 6, 128))
    image = noise((3, 2, 33, 21))
    found = []
    most = numba.get_num_threads()
    try:
        for threads in range(1, most + 1):
            numba.set_num_threads(threads)
            found.append((operator.adjoint(data), operator.forward(image)))
    finally:
        numba.set_num_threads(most)
    for other in found[1:]:
        assert np.array_equal(found[0][0], other[0])
        assert np.array_equal(found[0][1], other[1])


@pytest.mark.parametrize("channels", [1, 2, 3])
@pytest.mark.parametrize(
    "kind", [{}, {"half_space": 3.4}, {"tx_pattern": lambda position, points: points[:, 1]}]
)
def test_kept_delays_and_phasors_give_the_bits_of_those_found_anew(kind, channels, monkeypatch):
    def results(kept):
        monkeypatch.setattr("flgpr.imaging.cpu.KEPT_BYTES", kept)
        operator = ImagingOperator(
            TONES, TX, RX, grid() - [0, 0, 0.1], BANDS[:1], method="profile", **kind
        )
        data = noise((channels, 6, 128))
        image = noise((channels, 1, 33, 21))
        return [(operator.adjoint(data), operator.forward(image)) for _ in range(3)]

    for one, other in zip(results(0), results(1 << 26), strict=True):
        assert np.array_equal(one[0], other[0])
        assert np.array_equal(one[1], other[1])


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
def test_a_channel_alone_agrees_with_the_direct_sums_at_every_width(tolerance):
    data = noise((1, 6, 128))
    image = noise((1, 1, 33, 21))
    direct = ImagingOperator(TONES, TX, RX, grid(), dtype="complex128", method="direct")
    fast = ImagingOperator(
        TONES, TX, RX, grid(), tolerance=tolerance, method="profile", dtype="complex64"
    )
    for exact, found in (
        (direct.adjoint(data), fast.adjoint(data)),
        (direct.forward(image), fast.forward(image)),
    ):
        assert np.linalg.norm(found - exact) < tolerance * np.linalg.norm(exact)


def test_scans_on_leading_axes_are_imaged_one_by_one():
    operator = ImagingOperator(TONES, TX, RX, grid(), BANDS, method="profile")
    data = noise((2, 4, 3, 6, 128))
    images = operator.adjoint(data)
    assert images.shape == (2, 4, 3, 2, 33, 21)
    assert images[1, 2] == pytest.approx(operator.adjoint(data[1, 2]), rel=1e-4, abs=1e-3)
    back = operator.forward(images)
    assert back.shape == data.shape
    assert back[0, 3] == pytest.approx(operator.forward(images[0, 3]), rel=1e-4, abs=1)


def test_images_go_where_they_are_told():
    operator = ImagingOperator(TONES, TX, RX, grid(), BANDS)
    data = noise((1, 6, 128))
    out = np.empty((1, 2, 33, 21), np.complex64)
    assert operator.adjoint(data, out=out) is out
    assert np.array_equal(out, operator.adjoint(data))
    with pytest.raises(
        ValueError, match=r"out must be contiguous complex64 of the shape \(1, 2, 33, 21\)"
    ):
        operator.adjoint(data, out=out[..., :5])


@pytest.mark.parametrize(
    "kind", [{"method": "profile"}, {"method": "direct"}, {"dtype": "complex128"}]
)
@pytest.mark.parametrize("rows", [1, 20, 33, 40])
def test_the_nearest_rows_alone_have_the_bits_of_the_whole_image(kind, rows):
    operator = ImagingOperator(TONES, TX, RX, grid(), BANDS, **kind)
    data = noise((2, 3, 6, 128))
    np.testing.assert_array_equal(
        operator.adjoint(data, rows=rows), operator.adjoint(data)[..., :rows, :]
    )


def test_no_polarization_gives_no_image():
    operator = ImagingOperator(TONES, TX, RX, grid(), BANDS)
    assert operator.adjoint(np.zeros((0, 6, 128))).shape == (0, 2, 33, 21)
    assert operator.forward(np.zeros((0, 2, 33, 21))).shape == (0, 6, 128)


@pytest.mark.parametrize("window", ["hann", "hamming", "taylor"])
def test_named_windows_weigh_every_subband(window):
    named = ImagingOperator(TONES, TX, RX, grid(), BANDS, window=window)
    data = noise((1, 6, 128))
    image = named.adjoint(data)
    for s, band in enumerate(BANDS):
        inside = named.weight[s] > 0
        single = ImagingOperator(TONES, TX, RX, grid(), (band,), window=named.weight[s])
        assert inside.sum() >= 49
        assert image[0, s] == pytest.approx(single.adjoint(data)[0, 0], rel=2e-3, abs=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tolerance": 0}, r"tolerance must lie between 1e-12 and 1, got 0"),
        (
            {"tolerance": 1e-6, "dtype": "complex64"},
            r"tolerance must be at least 1e-05 in complex64, got 1e-06",
        ),
        ({"dtype": "float32"}, r"dtype must be complex64 or complex128, got float32"),
        ({"device": "tpu"}, r"device must be .*, got 'tpu'"),
        ({"method": "guess"}, r"method must be .*, got 'guess'"),
        ({"permittivity": 0.5}, r"permittivity must be at least 1, got 0.5"),
        (
            {"half_space": 0.5},
            r"half_space must be a relative permittivity of at least 1, that above, got 0.5",
        ),
        (
            {"subbands": ((5e9, 6e9),)},
            r"subbands must each hold a tone; 5e\+09 to 6e\+09 Hz holds none",
        ),
        ({"subbands": ()}, r"subbands must name at least one"),
        (
            {"path_offset": [1.0]},
            r"path_offset must hold one finite length per pair \(6\), got shape \(1,\)",
        ),
        ({"window": "kaiser"}, r"window must be one of .* got 'kaiser'"),
        (
            {"window": [1.0, 2.0]},
            r"window must hold one finite weight per tone \(128\), got shape \(2,\)",
        ),
        (
            {"rx_position": RX[:2]},
            r"tx_position and rx_position must both have the shape \(pair, 3\)",
        ),
        ({"pixels": np.zeros((3, 2))}, r"pixels must have the shape \(..., 3\)"),
        (
            {"tx_pattern": lambda position, points: np.ones(3)},
            r"tx_pattern must return one finite amplitude per pixel",
        ),
    ],
)
def test_bad_arguments_are_named(change, message):
    good = {
        "frequency": TONES,
        "tx_position": TX,
        "rx_position": RX,
        "pixels": grid(),
        "subbands": BANDS,
    }
    with pytest.raises(ValueError, match=message):
        ImagingOperator(**{**good, **change})


def test_bad_data_are_named():
    operator = ImagingOperator(TONES, TX, RX, grid(), BANDS)
    with pytest.raises(
        ValueError,
        match=r"data must have the shape \(..., polarization, 6, 128\), got \(1, 128, 6\)",
    ):
        operator.adjoint(np.zeros((1, 128, 6)))
    bad = noise((1, 6, 128))
    bad[0, 2, 3] = np.nan
    with pytest.raises(ValueError, match=r"data must be finite, got 1 of 768 values that are not"):
        operator.adjoint(bad)
    with pytest.raises(ValueError, match=r"image must have the shape"):
        operator.forward(np.zeros((1, 2, 21, 33)))


def test_large_but_finite_data_are_accepted():
    operator = ImagingOperator(TONES, TX, RX, grid(3, 3), BANDS)
    data = np.full((1, 6, 128), 1e35, np.complex64)
    assert np.isfinite(operator.adjoint(data)).all()


def test_pixels_of_a_volume_and_a_surface_keep_their_shape():
    x, y, z = np.meshgrid(
        np.linspace(-1, 1, 5), np.linspace(8, 10, 7), np.linspace(-0.4, 0.2, 3), indexing="ij"
    )
    volume = np.stack([x, y, z], axis=-1)
    data = noise((2, 6, 128))
    images = ImagingOperator(TONES, TX, RX, volume, BANDS, tolerance=1e-4).adjoint(data)
    assert images.shape == (2, 2, 5, 7, 3)
    surface = volume[:, :, 0].copy()
    surface[..., 2] = 0.1 * np.sin(surface[..., 0])
    on_surface = ImagingOperator(TONES, TX, RX, surface, BANDS, tolerance=1e-4).adjoint(data)
    assert on_surface.shape == (2, 2, 5, 7)
    # At x = 0 the surface passes through z = 0, between two layers of the volume: a third operator
    # knows that line.
    line = surface[2]
    assert line[:, 2] == pytest.approx(np.zeros(7))
    alone = ImagingOperator(TONES, TX, RX, line, BANDS, method="direct").adjoint(data)
    assert np.linalg.norm(on_surface[:, :, 2] - alone) < 3e-4 * np.linalg.norm(alone)


def test_the_backend_follows_from_tolerance_and_work():
    frequency = 1e9 + 5e6 * np.arange(64)
    antennas = np.array([[0.0, 0.0, 1.5]])
    x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(3, 5, 20))
    pixels = np.stack([x, y, 0 * x], axis=-1)

    def backend(points=pixels, **options):
        return type(ImagingOperator(frequency, antennas, antennas, points, **options).backend)

    assert backend() is ProfileBackend
    assert backend(tolerance=1e-8) is PreciseBackend
    assert backend(method="direct") is DirectBackend
    assert backend(pixels[:1, :1]) is DirectBackend
    with pytest.raises(ValueError, match="method must be"):
        backend(method="fast")
    with pytest.raises(ValueError, match="device must be 'cpu' or 'cuda'"):
        backend(device="tpu")

import numpy as np
import pytest

from flgpr.clutter import fit_by_model, suppress_by_model
from flgpr.imaging import ImagingOperator
from flgpr.kernels.windows import hann

FREQUENCY = 0.5e9 + 10e6 * np.arange(100)
TX = np.repeat([[-0.9, 0, 1.5], [0.9, 0, 1.5]], 8, axis=0)
RX = np.tile(np.column_stack([np.linspace(-1, 1, 8), np.zeros(8), np.full(8, 1.5)]), (2, 1))


def operator(points):
    return ImagingOperator(FREQUENCY, TX, RX, points, tolerance=1e-5)


def square(x, y, half=0.15, step=0.05):
    along = np.arange(-half, half + 1e-9, step)
    points = np.zeros((along.size, along.size, 3))
    points[..., 0], points[..., 1] = np.meshgrid(x + along, y + along)
    return points


def data(x, y):
    return operator([[x, y, 0.0]]).forward(np.ones((1, 1, 1)))


def peak(signal, x, y):
    return np.abs(operator(square(x, y)).adjoint(signal)).max()


def test_a_scatterer_under_the_mask_goes_and_one_outside_stays():
    strong = 10 * data(-1.23, 4.02)
    weak = data(0.52, 3.0)
    mask = operator(square(-1.2, 4.0))
    result = suppress_by_model(strong + weak, mask, iterations=40)
    assert 20 * np.log10(peak(result.data, -1.2, 4.0) / peak(strong, -1.2, 4.0)) < -40
    assert 20 * np.log10(peak(result.data, 0.5, 3.0) / peak(weak, 0.5, 3.0)) == pytest.approx(
        0, abs=0.1
    )


def test_what_the_spared_pixels_explain_stays():
    """A mine close to the mask: the plain fit takes a part of it, the fit that knows its place does not."""
    bush = 10 * data(-0.61, 4.02)
    mine = data(-0.38, 4.0)
    under = square(-0.6, 4.0, 0.1)
    road = square(-0.3, 4.0, 0.15)
    both = np.concatenate([under.reshape(-1, 3), road.reshape(-1, 3)])
    spared = np.arange(len(both)) >= under.shape[0] * under.shape[1]
    lost = {}
    for name, pixels, kept in (("plain", under, None), ("spared", both, spared)):
        results = [
            suppress_by_model(signal, operator(pixels), 60, spared=kept).data
            for signal in (bush + mine, bush)
        ]
        at = [
            np.abs(operator([[-0.38, 4.0, 0.0]]).adjoint(one)).item()
            for one in (results[0] - results[1], mine)
        ]
        lost[name] = 20 * np.log10(at[0] / at[1])
        assert 20 * np.log10(peak(results[1], -0.6, 4.0) / peak(bush, -0.6, 4.0)) < -15
    assert lost["plain"] < -1.5
    assert abs(lost["spared"]) < abs(lost["plain"]) / 2
    none = np.zeros(len(both), bool)
    plain, same = (
        suppress_by_model(bush, operator(both), 5, spared=kept).data for kept in (None, none)
    )
    np.testing.assert_array_equal(plain, same)
    with pytest.raises(ValueError, match="spared must have the shape of the pixels"):
        suppress_by_model(bush, operator(both), 5, spared=none[1:])


def test_the_residual_never_rises():
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(2, 16, 100)) + 1j * rng.normal(size=(2, 16, 100))
    course = suppress_by_model(noise, operator(square(0, 3)), iterations=30).residual
    assert (np.diff(course) <= 1e-6).all()
    assert course[-1] < 0.999


def test_the_fitted_ground_explains_what_is_subtracted_and_foretells_another_view():
    points = square(0.3, 4.0)
    received = data(0.3, 4.0)
    ground = fit_by_model(received, operator(points), 6)
    left = suppress_by_model(received, operator(points), iterations=6).data
    np.testing.assert_allclose(
        received - operator(points).forward(ground), left, atol=1e-4 * np.abs(received).max()
    )
    # Half a metre nearer the same ground gives what the scatterer gives there, to 20 dB.
    nearer = points - [0, 0.5, 0]
    seen = data(0.3, 3.5)
    assert np.linalg.norm(operator(nearer).forward(ground) - seen) < 0.1 * np.linalg.norm(seen)
    assert not fit_by_model(np.zeros_like(received), operator(points)).any()


def test_a_taper_keeps_the_direct_coupling_out_of_the_fit():
    """A strong echo from far outside the mask leaks into it through the band's sidelobes unless they are tapered."""
    coupling = (
        1000
        * np.exp(-2j * np.pi * FREQUENCY * 1.0 / 299792458.0)[None, None, :]
        * np.ones((1, 16, 1))
    )
    target = data(0.0, 3.0)
    mask = operator(square(0, 3))
    position = FREQUENCY - FREQUENCY.mean()
    weight = hann(2 * position / np.ptp(FREQUENCY))
    with_taper = suppress_by_model(coupling + target, mask, 5, weight).data
    without = suppress_by_model(coupling + target, mask, 5).data
    kept = [
        np.linalg.norm(one - coupling) / np.linalg.norm(target) for one in (with_taper, without)
    ]
    assert kept[0] < 0.5
    assert kept[1] > 10 * kept[0]


def test_zero_data_and_bad_counts():
    assert not suppress_by_model(np.zeros((1, 16, 100)), operator(square(0, 3)), 3).data.any()
    with pytest.raises(ValueError, match="iterations"):
        suppress_by_model(data(0, 3), operator(square(0, 3)), 0)

import numpy as np
import pytest

from flgpr.clutter.estimator import mean_filtered
from flgpr.kernels.filters import median_stack
from flgpr.kernels.sampling import bilinear
from reference.wang2007 import filtered


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ((1, 1), (5, 3)),
        ((3, 40), (21, 21)),
        ((23, 17), (1, 1)),
        ((23, 17), (5, 3)),
        ((40, 5), (21, 21)),
    ],
)
def test_filters_equal_their_plain_twins_to_the_border(shape, size):
    rng = np.random.default_rng(3)
    image = rng.normal(size=shape).astype(np.float32)
    image[rng.random(shape) < 0.3] = 0.5  # ties
    np.testing.assert_array_equal(
        median_stack(image[None], size)[0], filtered(image, size, np.median).astype(np.float32)
    )
    image = np.abs(image)
    means = mean_filtered(image[None].astype(float), (1, 1, *shape), size, 1)
    np.testing.assert_allclose(means[0, 0], filtered(image, size, np.mean), rtol=1e-6)


def test_bilinear_is_exact_on_a_plane_and_nan_outside():
    y, x = np.mgrid[0:6, 0:9]
    plane = np.stack([2.0 * y - 3.0 * x + 1, 0.5 * x])
    rng = np.random.default_rng(1)
    row = rng.uniform(0, 5, 50)
    column = rng.uniform(0, 8, 50)
    np.testing.assert_allclose(bilinear(plane, row, column)[0], 2 * row - 3 * column + 1, atol=1e-5)
    got = bilinear(plane, np.array([-0.01, 5.0, 0.0]), np.array([0.0, 8.0, 8.01]))
    assert np.isnan(got[0]).tolist() == [True, False, True]


@pytest.mark.parametrize("kind", [np.float32, np.complex64])
@pytest.mark.parametrize("shape", [(1, 12), (12, 1), (5, 7)])
def test_bilinear_is_its_definition_to_the_border_of_any_image(kind, shape):
    rng = np.random.default_rng(2)
    image = (rng.normal(size=(3, 2, *shape)) + 1j * rng.normal(size=(3, 2, *shape))).astype(
        np.complex64
    )
    image = image if kind == np.complex64 else np.ascontiguousarray(image.real)
    row = rng.uniform(-1, shape[0], (4, 25))
    column = rng.uniform(-1, shape[1], (4, 25))
    row[0] = 0.0
    column[0] = np.linspace(0, shape[1] - 1, 25)
    got = bilinear(image, row, column)
    assert got.dtype == kind
    assert got.shape == (3, 2, 4, 25)
    padded = np.pad(image, ((0, 0), (0, 0), (0, 1), (0, 1)), mode="edge").astype(complex)
    for at, (r, c) in enumerate(zip(row.ravel(), column.ravel(), strict=True)):
        one = got.reshape(3, 2, -1)[..., at]
        if 0 <= r <= shape[0] - 1 and 0 <= c <= shape[1] - 1:
            i = int(r)
            j = int(c)
            (a, b), (d, e) = (padded[:, :, i + k, j : j + 2].transpose(2, 0, 1) for k in (0, 1))
            want = (1 - r + i) * ((1 - c + j) * a + (c - j) * b) + (r - i) * (
                (1 - c + j) * d + (c - j) * e
            )
            np.testing.assert_allclose(one, want if kind == np.complex64 else want.real, atol=1e-5)
        else:
            assert np.isnan(one).all()


@pytest.mark.parametrize(
    ("size", "step"),
    [((1, 1), 2), ((21, 21), 2), ((5, 3), 1), ((5, 3), 7), ((7, 9), 3), ((21, 21), 7)],
)
def test_the_median_of_a_stack_is_exact_in_single_precision_too(size, step):
    rng = np.random.default_rng(4)
    stack = rng.normal(size=(3, 37, 29)).astype(np.float32)
    stack[1] = np.round(stack[1])  # ties, and zeros of both signs
    stack[2] *= 10.0 ** rng.integers(-20, 20, stack[2].shape)
    got = median_stack(stack, size, step)
    for one, image in zip(got, stack, strict=True):
        want = filtered(image.astype(np.float64), size, np.median)[::step, ::step]
        np.testing.assert_array_equal(one, want.astype(np.float32))


def test_a_plain_value_is_its_own_median():
    np.testing.assert_array_equal(
        median_stack(np.full((2, 9, 8), -0.5), (3, 5)), np.full((2, 9, 8), -0.5)
    )
    assert median_stack(np.zeros((0, 9, 8)), (3, 5)).shape == (0, 9, 8)


@pytest.mark.parametrize(
    ("shape", "size", "step"), [((300, 300), (257, 257), 150), ((300, 800), (257, 771), 257)]
)
def test_the_median_of_a_window_of_more_pixels_than_16_bits_count(shape, size, step):
    image = np.random.default_rng(5).normal(size=shape).astype(np.float32)
    got = median_stack(image[None], size, step)[0]
    for (row, column), value in np.ndenumerate(got):
        y = row * step
        x = column * step
        window = image[
            max(y - size[0] // 2, 0) : y + size[0] // 2 + 1,
            max(x - size[1] // 2, 0) : x + size[1] // 2 + 1,
        ]
        assert value == np.float32(np.median(window.astype(np.float64)))

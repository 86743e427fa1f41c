"""The figure of depth slices: a panel per depth on one scale."""

import numpy as np
import xarray as xr

from flgpr.report.images import slices_figure


def test_every_slice_is_drawn_relative_to_the_strongest_pixel_of_all():
    values = np.ones((1, 5, 4, 3), np.complex64)
    values[0, 2, 1, 1] = 10.0
    coords = {
        "polarization": ["HH"],
        "z": -0.1 * np.arange(5),
        "y": np.arange(4) * 0.5,
        "x": np.arange(3) * 0.5,
    }
    image = xr.DataArray(values, dims=tuple(coords), coords=coords, attrs={"title": "a line"})
    figure = slices_figure(image, np.zeros((2, 6)), span=30.0)
    drawn = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title() for axes in drawn] == [
        f"{depth:g} m below" for depth in -image["z"].values
    ]
    levels = [axes.images[0].get_array() for axes in drawn]
    assert max(level.max() for level in levels) == 0
    assert levels[0].max() == -20
    assert {axes.images[0].get_clim() for axes in drawn} == {(-30.0, 0.0)}
    assert sum(axes.axison for axes in figure.axes[:8]) == 5  # the last three panels are empty

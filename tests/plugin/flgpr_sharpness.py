"""A feature from another distribution: how far an alarm stands out of the ring around it."""

import numpy as np

from flgpr.screen import sample_scan
from flgpr.stages import FeatureStage, Positive, Table


class SharpnessSettings(Table):
    """Radius of the ring, m."""

    radius: Positive = 0.4


class Sharpness(FeatureStage):
    """Magnitude at the alarm over the mean on the ring, in dB, for every polarization of the first sub-band."""

    Settings = SharpnessSettings

    def __init__(self, settings, setup, learnt=None):
        super().__init__(settings, setup, learnt)
        self.columns = tuple(f"sharp_{label}" for label in setup.imager.run["polarization"].values)

    def of_image(self, image, points):
        angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = points[:, None] + self.settings.radius * np.column_stack(
            [np.cos(angle), np.sin(angle)]
        )
        centre = sample_scan(image, points)[:, 0]
        around = sample_scan(image, ring)[:, 0].mean(axis=-1)
        return dict(zip(self.columns, 20 * np.log10(centre / around), strict=True))

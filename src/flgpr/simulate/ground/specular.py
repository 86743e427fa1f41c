"""The specular echo of the mean surface: every transmitter's image in the ground, seen by a receiver.

An antenna over plane ground is received as if it stood mirrored below it, weakened by Fresnel's
reflection at the pair's angle: exact over a perfect conductor, and over soil up to terms of
``1/(k·r)`` (Banos 1966). Roughness takes from it what it scatters: ``exp(-2(k·s·cosθ)²)`` in
amplitude (Ament 1953).
"""

from __future__ import annotations

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.bodies.rims import layered_reflection
from flgpr.simulate.ground.layers import through_grass
from flgpr.simulate.ground.roughness import uneven_height
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.radar.coupling import beam, path_transfer, port_directions
from flgpr.simulate.radar.spread import ArrayState
from flgpr.simulate.scene.scene import Surface
from flgpr.simulate.scene.scene_tables import Grass
from flgpr.types import Complex128Array, ComplexArray, FloatArray

_LEAST_SINE = 1e-9  # below it every plane holds the ray: one is chosen
# Places in the first Fresnel zone, in its radii: the echo comes from all of it.
_ZONE = np.stack(np.meshgrid([-0.7, 0.0, 0.7], [-0.7, 0.0, 0.7]), axis=-1).reshape(-1, 2)


class SpecularEcho:
    """The echo of the mean surface below an array.

    Parameters
    ----------
    surface : Surface
        Its roughness is what the echo loses; the unevenness counts up to waves of 3 m.
    grass : Grass
        It weakens what goes through it and back.
    ground : LayeredGround
        Permittivities of all layers at the tones.
    terrain : TerrainHeights
        Heights and slopes of the mean surface.
    side_db : float
        As in :func:`flgpr.simulate.radar.coupling.beam`: horns that look ahead meet the ground
        below them by their sides.
    """

    def __init__(
        self,
        surface: Surface,
        grass: Grass,
        ground: LayeredGround,
        terrain: TerrainHeights,
        side_db: float,
    ) -> None:
        uneven = uneven_height(surface.unevenness, surface.waviness)
        self.rms_height = float(np.hypot(surface.rms_height, uneven))
        self._grass = grass
        self._ground = ground
        self._terrain = terrain
        self._side_db = side_db

    def __call__(self, array: ArrayState) -> ComplexArray:
        """Return the echo (4, pair, frequency), HH, HV, VH and VV, as the array's antennas take it.

        A pair with an antenna below the mean surface has none.
        """
        base, normal = self._planes(array)
        tx = array.position[array.tx]
        rx = array.position[array.rx]
        above_tx = _dot(tx - base, normal)
        above_rx = _dot(rx - base, normal)
        offset = rx - tx + 2 * above_tx[:, None] * normal  # from the mirrored transmitter
        distance = np.linalg.norm(offset, axis=1)
        arriving = offset / distance[:, None]
        cosine = _dot(arriving, normal)
        leaving = arriving - 2 * cosine[:, None] * normal
        reflection = self.reflection(np.clip(cosine, 0, 1))
        frequency = self._ground.frequency
        mirrored = _Mirrored(array, leaving, arriving, normal)
        across, along = mirrored.products(*reflection)
        patterns = beam(array, leaving, frequency, self._side_db)
        patterns = patterns * beam(array, -arriving, frequency, self._side_db)
        patterns = patterns * ((above_tx > 0) & (above_rx > 0))[:, None]
        total = patterns * path_transfer(array, distance, frequency, across, along)
        return total.reshape(4, *total.shape[2:]).astype(np.complex64)

    def reflection(self, cosine: FloatArray) -> tuple[Complex128Array, Complex128Array]:
        """Return what the rough, grown ground reflects of H and of V (ray, frequency).

        Parameters
        ----------
        cosine : ndarray (ray,)
            Cosine of the angle of incidence.
        """
        ground = self._ground
        sine = np.sqrt(1 - cosine**2)
        thickness = [layer.thickness for layer in ground.soil.layers]
        h, v = layered_reflection(
            sine[:, None], ground.wavenumber, ground.media_from_air, thickness
        )
        coherent = np.exp(-2 * (ground.wavenumber * self.rms_height * cosine[:, None]) ** 2)
        grown_h, grown_v, _ = through_grass(self._grass, ground.frequency, sine)
        return h * coherent * grown_h, v * coherent * grown_v

    def _planes(self, array: ArrayState) -> tuple[FloatArray, FloatArray]:
        """Return a point of the mean ground (pair, 3), m, and its normal (pair, 3), of each pair.

        Height and slope are means over the first Fresnel zone of the band's middle about the
        specular point, where the ground is taken for level to find that point.
        """
        tx = array.position[array.tx]
        rx = array.position[array.rx]
        base = np.zeros_like(tx)
        normal = np.zeros_like(tx)
        normal[:, 2] = 1.0
        if self._terrain.flat:
            return base, normal
        middle = (tx + rx) / 2
        below = self._terrain.relief(middle[:, :2])[:, 0]
        h_tx = np.maximum(tx[:, 2] - below, 1e-3)
        h_rx = np.maximum(rx[:, 2] - below, 1e-3)
        share = (h_tx / (h_tx + h_rx))[:, None]
        base[:, :2] = tx[:, :2] + share * (rx - tx)[:, :2]
        centre = self._ground.frequency[self._ground.middle]
        radius = np.sqrt(SPEED_OF_LIGHT / centre * h_tx * h_rx / (h_tx + h_rx))
        places = base[:, None, :2] + radius[:, None, None] * _ZONE
        relief = self._terrain.relief(places.reshape(-1, 2)).reshape(len(base), -1, 3)
        height, slope_x, slope_y = relief.mean(axis=1).T
        base[:, 2] = height
        normal[:, :2] = -np.column_stack([slope_x, slope_y])
        return base, normal / np.linalg.norm(normal, axis=1, keepdims=True)


class _Mirrored:
    """Ports of transmitters mirrored in the ground, against those of the receivers.

    The mirrored port has its part across the plane of incidence times Fresnel's H, its part in
    that plane with the level component turned round, times Fresnel's V. Over a perfect conductor
    (-1 and +1) that is the image of a current.
    """

    def __init__(
        self, array: ArrayState, leaving: FloatArray, arriving: FloatArray, normal: FloatArray
    ) -> None:
        sent = port_directions(array, leaving)
        taken = port_directions(array, -arriving)
        level = np.cross(normal, arriving)
        size = np.linalg.norm(level, axis=1, keepdims=True)
        any_level = np.cross(normal, [0.0, 1.0, 0.0])
        any_level /= np.linalg.norm(any_level, axis=1, keepdims=True)
        level = np.where(size > _LEAST_SINE, level / np.maximum(size, _LEAST_SINE), any_level)
        ahead = np.cross(level, normal)
        self._sent = [np.einsum("pic,pc->ip", sent, axis) for axis in (level, ahead, normal)]
        self._taken = [np.einsum("pjc,pc->jp", taken, axis) for axis in (level, ahead, normal)]
        self._sent[1] = -self._sent[1]
        self._arriving = (_dot(arriving, ahead), _dot(arriving, normal))
        self._taken_along = np.einsum("pjc,pc->jp", taken, arriving)

    def products(
        self, h: Complex128Array, v: Complex128Array
    ) -> tuple[Complex128Array, Complex128Array]:
        """Return the products of ports across and along the path (tx, rx, pair, frequency).

        ``h`` and ``v`` (pair, frequency) are the ground's reflection.
        """
        level, ahead, up = (part[:, None] for part in self._sent)
        to_level, to_ahead, to_up = self._taken
        in_h = level * to_level
        in_v = ahead * to_ahead + up * to_up
        sent_along = ahead * self._arriving[0] + up * self._arriving[1]
        along = (sent_along * self._taken_along)[..., None] * v
        total = in_h[..., None] * h + in_v[..., None] * v
        return total - along, along


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the products (n,) of vectors (n, 3)."""
    return np.einsum("nc,nc->n", one, other)

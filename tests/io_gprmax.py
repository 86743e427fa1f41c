"""The field of a short dipole, as textbooks have it, and results of decks made of it."""

import h5py
import numpy as np

from flgpr.model import Sensor
from flgpr.simulate import Scene

SPEED = 299_792_458.0


def dipole_field(direction, offset, component, frequency):
    """Field of a short dipole of unit moment in air, near and far (Balanis 2016, Sec. 4.2), times j; V/m per A·m."""
    distance = np.linalg.norm(offset)
    ray = offset / distance
    kr = 2 * np.pi * frequency / SPEED * distance
    size = 2 * np.pi * frequency * 4e-7 * np.pi / (4 * np.pi * distance) * np.exp(-1j * kr)
    along = (ray @ direction) * ray[component]
    return size * (
        direction[component] * (1 - 1j / kr - 1 / kr**2) - along * (1 - 3j / kr - 3 / kr**2)
    )


def write_output(path, deck, point=None):
    """Write what gprMax would: each receiver's component of the fields of all dipoles, and of a scattering point."""
    lines = [line.split(": ", 1) for line in deck.splitlines()]
    told = {name: value for name, value in lines}
    cell = float(told["#dx_dy_dz"].split()[0])
    step = cell / (SPEED * np.sqrt(3))
    steps = round(float(told["#time_window"]) / step)
    # The fields are made at the bins of a long record, so that echoes do not fold back.
    count = 4 * steps
    f = np.fft.rfftfreq(count, step)[1:]
    words = [value.split() for name, value in lines if name == "#waveform"]
    amplitude = [float(w[1]) for w in words]
    centre = float(words[0][2])
    time = (np.arange(count) + 0.5) * step - 1 / centre
    width = 2 * np.pi**2 * centre**2
    current = -np.sqrt(2 * width * np.e) * time * np.exp(-width * time**2)
    moment = np.fft.rfft(current)[1:] * np.exp(-1j * np.pi * f * step) * cell
    dipoles = [value.split() for name, value in lines if name == "#hertzian_dipole"]
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {"gprMax": "3.1.7", "Title": told["#title"], "Iterations": steps, "dt": step}
        )
        file.attrs["dx_dy_dz"] = (cell, cell, cell)
        for n, (_, *place, _) in enumerate(dipoles):
            group = file.create_group(f"srcs/src{n + 1}")
            group.attrs.update({"Type": "HertzianDipole", "Position": np.array(place, float)})
        receivers = [value.split() for name, value in lines if name == "#rx"]
        for n, (*place, name, wanted) in enumerate(receivers):
            component = "xyz".index(wanted[1])
            at = np.array(place, float) + cell / 2 * (np.arange(3) == component)
            total = np.zeros(f.size, complex)
            for (axis, *source, _), size in zip(dipoles, amplitude, strict=True):
                unit = np.eye(3)["xyz".index(axis)]
                start = np.array(source, float) + cell / 2 * unit
                total += size * dipole_field(unit, at - start, component, f)
                if point is not None:
                    there = np.array([dipole_field(unit, point - start, c, f) for c in range(3)])
                    back = [dipole_field(np.eye(3)[c], at - point, component, f) for c in range(3)]
                    total += size * 1e-3 * (there * back).sum(axis=0)
            spectrum = np.concatenate([[0], -1j * total * moment])
            group = file.create_group(f"rxs/rx{n + 1}")
            group.attrs.update({"Name": name, "Position": np.array(place, float)})
            group[wanted] = np.fft.irfft(spectrum, count)[:steps].astype(np.float32)


def lane_and_sensor():
    """An empty scene and a sensor whose antennas lie on nodes of the 19 mm grid, which keeps the results small."""
    sensor = Sensor(
        name="two dipoles", source="test", polarization=("HH", "VV", "HV"), height=0.475, tilt=0.3,
        tx=((0.0, 0.0, 0.0),), rx=((0.38, 0.0, 0.0), (-0.342, 0.095, 0.0)),
        tones={"start": 600e6, "step": 50e6, "count": 15}, antenna={"kind": "dipole"},
    )  # fmt: skip
    scene = Scene(
        length=0.8, x_min=-0.3, x_max=0.3, surface={"rms_height": 0.0}, track={"positions": (0.03,)},
        soil={"model": "fixed", "permittivity": 1.0}, targets=[{"kind": "metal", "x": 0.0, "y": 0.5, "radius": 0.05}],
    )  # fmt: skip
    return scene, sensor

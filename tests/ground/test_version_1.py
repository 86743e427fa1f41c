"""Version 1 of the proving ground is frozen: its description, its sites, its lanes and its titles."""

import hashlib
from importlib import resources

import numpy as np
import pytest

from flgpr.proving_ground import load_ground
from flgpr.store import write_whole
from flgpr_ground.lanes import PRINTS, fingerprint, same_lanes

NAME = "proving-ground-1"
FILES = {
    "flgpr_ground/proving-ground-1.toml": "5a7463213ae4a6194f0e027dd1afa14c4952115053bf7b58cd823bd338d18600",
    "flgpr.simulate.scene/sites/arid-sand.toml": "0688489fef1f50b2554978114aaf9e28b2beffa730d1427f19b0f6addd7c97de",
    "flgpr.simulate.scene/sites/temperate.toml": "3ed1c5b11577fbdb8a34b117e8a52adca0e3940126ee2e77094129cf91bd7f2a",
    "flgpr.simulate.scene/sites/gravel.toml": "b7314a9f107825793f0dd0ec2dd070a4d3049b175fb1b57980e70453e5c2a24a",
    "flgpr.simulate.scene/sites/wet-clay.toml": "74a301a18700ac1147285c6f32da26daa645d5e613dea665dd713a4597c35a9f",
}
"""SHA-256 of what the lanes are made from."""
LANES = {
    False: "e2ed4bb476ad42097d3b6b7545108b28dd2b56eb7c67c90105a504823576b541",
    True: "92424767d583034956f72146d06ec0b5a98c0c331b61f68c1f9def924763f133",
}
"""SHA-256 of the lanes of the full and of the quick form, by :func:`lane_lines`."""


def lane_lines(ground):
    """Write names, parts, seeds, borders and targets of all lanes; millimetres, so that the last bit does not count."""
    lines = []
    for name, lane in ground.lanes.items():
        lines.append(
            f"{name} {lane.site} {lane.part} {lane.seed} {lane.length:.3f} {lane.sensor.height:.3f}"
        )
        for target in lane.truth().to_dict("records"):
            lines.append(
                f"{target['target_id']} {target['kind']} {target['x']:.3f} {target['y']:.3f}"
            )
            lines.append(f"{target['depth']:.3f} {target['radius']:.3f} {target['height']:.3f}")
    return lines


def digest(lines):
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


@pytest.mark.parametrize("file", FILES)
def test_its_description_and_sites_are_as_they_were(file):
    package, name = file.split("/", 1)
    content = (resources.files(package) / name).read_bytes().replace(b"\r\n", b"\n")
    assert hashlib.sha256(content).hexdigest() == FILES[file]


@pytest.mark.parametrize(("quick", "title"), [(False, NAME), (True, f"{NAME}-quick")])
def test_its_lanes_and_titles_are_as_they_were(quick, title):
    ground = load_ground(quick, NAME)
    assert ground.title == title
    assert digest(lane_lines(ground)) == LANES[quick]


@pytest.mark.slow("simulates a lane in full")
def test_a_lane_of_it_is_simulated_as_it_was(tmp_path):
    ground = load_ground(True, NAME)
    name = "arid-test-1"
    ground.lanes[name].make(tmp_path / f"{name}.zarr")
    row = fingerprint(tmp_path, name)
    columns = ",".join(row)
    values = ",".join(
        f"{value:.7g}" if isinstance(value, np.floating) else str(value) for value in row.values()
    )
    write_whole(tmp_path / PRINTS, f"{columns}\n{values}\n")
    assert same_lanes(ground, tmp_path)[name] in {"same bits", "alike"}

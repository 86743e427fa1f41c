"""Nothing that a file or the working folder holds leads to other files, or to code: recordings, maps, settings."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import flgpr
from flgpr.commands.app import app
from flgpr.formats import read_gpr
from flgpr.formats.arrays import open_arrays
from flgpr.formats.explain import explain_file
from flgpr.geo import map_backdrop, read_anchor
from flgpr.geo.geodesy import lonlat_of, transform_lonlat
from flgpr.store import json_with_digest, parse_with_digest, sample_lane, save_run
from flgpr_exchange.gprmax.explain import explain_merged
from flgpr_exchange.gprmax.output import read_gprmax
from io_gpr import write_dt1, write_dzt, write_mala
from io_recordings import COUNTS

SECRET = np.arange(64.0) + 1000


@pytest.fixture
def secret(tmp_path):
    """A file of HDF5 and one of bare numbers, which nobody named."""
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["numbers"] = SECRET
        file.create_group("rxs/rx1")
    (tmp_path / "secret.bin").write_bytes(SECRET.tobytes())
    return tmp_path


def with_external_numbers(file, name, folder):
    place = [(str(folder / "secret.bin"), 0, SECRET.nbytes)]
    file.create_dataset(name, SECRET.shape, SECRET.dtype, external=place)


def with_virtual_numbers(file, name, folder):
    layout = h5py.VirtualLayout(SECRET.shape, SECRET.dtype)
    layout[:] = h5py.VirtualSource(folder / "secret.h5", "numbers", SECRET.shape)
    file.create_virtual_dataset(name, layout)


def with_a_link(file, name, folder):
    file[name] = h5py.ExternalLink(folder / "secret.h5", "/numbers")


WAYS = {
    "external": (with_external_numbers, "its numbers lie in other files"),
    "virtual": (with_virtual_numbers, "its numbers lie in other files"),
    "link": (with_a_link, "it is a link to another file"),
}


@pytest.mark.slow("runs a whole command more than once")
@pytest.mark.parametrize("way", WAYS)
def test_numbers_of_other_files_are_not_read(secret, way):
    path = secret / "a.h5"
    with h5py.File(path, "w") as file:
        file["own"] = np.arange(3.0)
        WAYS[way][0](file, "group/stolen", secret)
    opened = open_arrays(path)
    assert list(opened.arrays) == ["own"]
    assert opened.about == [f"group/stolen: not read: {WAYS[way][1]}"] or (
        opened.about == [f"group/stolen: not read: {WAYS[way][1]}: copy them into this one"]
    )
    assert not any("1000" in line for line in explain_file(path).lines)


@pytest.mark.parametrize("way", ["external", "virtual"])
def test_a_file_that_is_changed_after_it_was_looked_at_reads_no_others(secret, way):
    path = secret / "a.h5"
    with h5py.File(path, "w") as file:
        file["data"] = np.zeros(64)
    opened = open_arrays(path)
    with h5py.File(path, "w") as file:
        WAYS[way][0](file, "data", secret)
    with pytest.raises(ValueError, match="data must hold its numbers itself"):
        opened.read("data")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("read", [read_gprmax, explain_merged])
def test_a_result_of_gprmax_holds_its_fields_itself(secret, way, read):
    path = secret / "a.out"
    with h5py.File(path, "w") as file:
        file.attrs.update({"gprMax": "3.1.7", "Iterations": 64, "dt": 1e-12})
        file.attrs["dx_dy_dz"] = (0.01, 0.01, 0.01)
        WAYS[way][0](file, "rxs/rx1/Ez", secret)
    with pytest.raises(ValueError, match=r"rxs/rx1/Ez must lie in this file"):
        read(path)


@pytest.mark.parametrize(
    "crs",
    [
        "+proj=utm +zone=33 +nadgrids={} +type=crs",
        "+proj=utm +zone=33 +geoidgrids={} +vunits=m +type=crs",
        "+init={}:key",
    ],
)
def test_a_reference_system_names_no_file(crs, tmp_path):
    """A pipe in place of the file: whoever opened it would wait for ever."""
    os.mkfifo(tmp_path / "grid")
    text = crs.format(tmp_path / "grid")
    with pytest.raises(ValueError, match=r"crs must be .* which names a file"):
        lonlat_of([[500_000.0, 5_300_000.0]], text)
    with pytest.raises(ValueError, match=r"crs must be .* which names a file"):
        transform_lonlat([15.0, 48.0], text)
    (tmp_path / "anchor.toml").write_text(
        f'crs = "{text}"\naccuracy = 0.1\nazimuth_deg = 0.0\nazimuth_accuracy_deg = 0.1\n'
        "[[point]]\nlane = [0, 0]\neasting = 500000.0\nnorthing = 5300000.0\n"
    )
    with pytest.raises(ValueError, match=r"anchor.toml: crs must be .* which names a file"):
        read_anchor(tmp_path / "anchor.toml")


def test_a_system_whose_file_is_none_is_read():
    web = "+proj=merc +a=6378137 +b=6378137 +units=m +nadgrids=@null +type=crs"
    np.testing.assert_allclose(
        transform_lonlat([15.0, 48.0], web), transform_lonlat([15.0, 48.0], "EPSG:3857"), atol=1.0
    )


def test_a_map_holds_its_overviews_itself(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    west, north = transform_lonlat([15.0, 48.0], "EPSG:32633") + [-100.0, 100.0]
    for name, size in (("secret.tif", 100), ("map.tif", 400)):
        pixel = 200 / size
        with rasterio.open(
            tmp_path / name, "w", driver="GTiff", width=size, height=size, count=1, dtype="uint8", crs="EPSG:32633",
            transform=rasterio.Affine(pixel, 0, west, 0, -pixel, north),
        ) as file:  # fmt: skip
            file.write(np.full((1, size, size), size % 251, "uint8"))
    tie = {"latitude": 48.0, "longitude": 15.0, "azimuth": 0.0}
    assert map_backdrop(tmp_path / "map.tif", tie, (-50.0, 50.0, -50.0, 50.0), most=50)
    with rasterio.open(tmp_path / "map.tif", "r+") as file:
        file.update_tags(ns="OVERVIEWS", OVERVIEW_FILE=str(tmp_path / "secret.tif"))
    with pytest.raises(ValueError, match="must hold its overviews itself"):
        map_backdrop(tmp_path / "map.tif", tie, (-50.0, 50.0, -50.0, 50.0), most=50)


def command(folder, *words, module=("-m", "flgpr")):
    """Give a command in a folder, as a user who stands in it does."""
    alone = {**os.environ, "PYTHONPATH": str(Path(flgpr.__file__).parents[1])}
    return subprocess.run(
        [sys.executable, *module, *words],
        cwd=folder,
        env=alone,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("name", "text", "library"),
    [
        ("matplotlibrc", "text.usetex: True\n", "Matplotlib"),
        (".numba_config.yaml", "cache_dir: cache\n", "Numba"),
    ],
)
def test_settings_of_libraries_in_the_working_folder_are_refused(name, text, library, tmp_path):
    """Those of Numba say from where compiled code is loaded, which is a pickle; Matplotlib's run LaTeX."""
    (tmp_path / name).write_text(text)
    ran = command(tmp_path, "recipe", "list")
    assert ran.returncode == 2
    assert (
        f"got {name}, which {library} would obey: give the command in another folder" in ran.stderr
    )
    assert "Traceback" not in ran.stderr


def test_modules_in_the_working_folder_are_not_imported(tmp_path):
    for name in ("typer", "numpy", "numba", "pydantic"):
        (tmp_path / f"{name}.py").write_text("open('marker', 'w')\nraise RuntimeError\n")
    offered = tmp_path / "gadget-1.dist-info"
    offered.mkdir()
    (offered / "METADATA").write_text("Name: gadget\nVersion: 1\n")
    (offered / "entry_points.txt").write_text("[flgpr.stages]\ngadget = gadget:Stage\n")
    (tmp_path / "gadget.py").write_text("open('marker', 'w')\n")
    (tmp_path / "own.toml").write_text('[[columns]]\nstage = "gadget"\n')
    ran = command(tmp_path, "recipe", "check", "own.toml")
    assert ran.returncode == 2, ran.stderr
    assert "stage must be one of" in ran.stderr
    assert not (tmp_path / "marker").exists()


@pytest.mark.slow("runs a whole command more than once")
def test_nothing_else_is_looked_for_in_the_working_folder(tmp_path):
    """What a command opens by a name alone, while it imports all that it may need and draws a figure."""
    program = (
        "import os, sys\n"
        "from flgpr.__main__ import OBEYED\n"
        "looked = set()\n"
        "stat = os.stat\n"
        "def note(path, *more, **options):\n"
        "    if isinstance(path, str) and path and not os.path.isabs(path) and 'dir_fd' not in options:\n"
        "        looked.add(path)\n"
        "    return stat(path, *more, **options)\n"
        "os.stat = note\n"
        "sys.addaudithook(lambda event, given: looked.add(given[0]) if event == 'open'\n"
        "    and isinstance(given[0], str) and not os.path.isabs(given[0]) else None)\n"
        "import flgpr.jit.compiled, flgpr.report.figures, flgpr.geo.anchor\n"
        "import flgpr.formats.arrays, flgpr.viewer.server\n"
        "from flgpr.report.kit import figure_png\n"
        "from matplotlib.figure import Figure\n"
        "figure = Figure(); figure.subplots().plot([1, 2], label='a'); figure.legend(); figure_png(figure)\n"
        "print(sorted(looked - set(OBEYED)))\n"
    )
    ran = command(tmp_path, program, module=("-P", "-c"))
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.strip() == "[]"


OF_THE_RESULT = ("run", "section", "libraries", "recipe_sha256")


@pytest.fixture
def own_result(demo, tmp_path):
    """A copy of a result whose manifest may be forged, and is then replayed."""
    folder = shutil.copytree(demo[0].folder, tmp_path / "result")

    def forge(**changes):
        manifest = parse_with_digest((folder / "manifest.json").read_bytes())
        content = {name: value for name, value in manifest.items() if name != "sha256"}
        for name, value in changes.items():
            (content if name in OF_THE_RESULT else content["run"])[name] = value
        (folder / "manifest.json").write_bytes(json_with_digest(content))
        return CliRunner().invoke(app, ["replay", str(folder), "--quiet"])

    return forge


@pytest.mark.parametrize(
    "path", ["pipe", "/dev/zero", "/etc/passwd", "no-store", "\0", "", 5, None, ["a"]]
)
def test_a_result_can_name_nothing_as_its_run_but_a_store(own_result, tmp_path, path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "no-store").mkdir()
    os.mkfifo(tmp_path / "no-store" / "commit.json")
    here = path in ("pipe", "no-store")
    ran = own_result(path=str(tmp_path / path) if here else path)
    assert ran.exit_code == 2, (ran.output, ran.exception)
    assert ran.stderr.count("error: ") == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("run", 5),
        ("libraries", None),
        ("recipe_sha256", [{}]),
        ("title", 5),
        ("scans", [{}]),
        ("scans", -1),
        ("masked_scans", 5),
        ("masked_scans", [{}]),
        ("motion", 5),
        ("motion", {"scans": ["a"]}),
        ("motion", {"notes": 5}),
        ("polarizations", 5),
        ("pose", [[{}]]),
        ("frequency_hz", [1.0]),
        ("store_sha256", 5),
        ("others", ["a"]),
        ("others", {"x": "/etc/passwd"}),
        ("others", {"x": {"path": "/etc", "store_sha256": "0"}}),
        ("section", 5),
        ("section", {"rows": [1], "lane": {}, "threshold": 0}),
    ],
)
def test_what_a_forged_manifest_says_is_refused(own_result, name, value):
    ran = own_result(**{name: value})  # as every command that reads the result
    assert ran.exit_code == 2, (ran.output, ran.exception)
    assert ran.stderr.count("error: ") == 1


def test_a_result_can_name_no_other_run_than_that_it_was_made_of(own_result, tmp_path):
    run = flgpr.open_run(sample_lane() / "run.zarr").load()
    other = save_run(run.assign_attrs(title="another"), tmp_path / "other.zarr")
    ran = own_result(path=str(other))
    assert ran.exit_code == 2, (ran.output, ran.exception)
    assert "run must be the one the result was made of" in ran.stderr
    assert str(other) in ran.stderr


def linked(path, target):
    """Put a file elsewhere, and a link to it in its place."""
    path.rename(target)
    path.symlink_to(target)


@pytest.mark.parametrize(
    ("write", "name", "companion"),
    [
        (write_dt1, "a.dt1", "a.hd"),
        (write_dt1, "a.dt1", "a.gps"),
        (write_dzt, "a.dzt", "a.dzx"),
        (write_dzt, "a.dzt", "a.dzg"),
        (write_mala, "a.rd3", "a.rad"),
        (write_mala, "a.rd3", "a.cor"),
    ],
)
def test_what_lies_beside_a_recording_is_no_link(write, name, companion, tmp_path):
    folder = tmp_path / "line"
    folder.mkdir()
    write(folder / name, COUNTS[:, None] if write is write_dzt else COUNTS)
    [beside] = [path for path in folder.iterdir() if path.name.lower() == companion] or [
        folder / companion
    ]
    if not beside.exists():
        beside.write_text("1,2,3\n")
    read_gpr(folder / name)
    linked(beside, tmp_path / "elsewhere")
    with pytest.raises(ValueError, match=r"must not be a symbolic link, got one to .*elsewhere"):
        read_gpr(folder / name)


def test_a_recording_that_is_a_link_is_read(tmp_path):
    """The user named it; what lies beside the name is looked for, not what lies beside its file."""
    write_dt1(tmp_path / "a.dt1", COUNTS)
    linked(tmp_path / "a.dt1", tmp_path / "far.dt1")
    assert len(read_gpr(tmp_path / "a.dt1").traces) == len(COUNTS)

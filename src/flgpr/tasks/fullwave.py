"""The bridge to a full-wave solver as files: decks out, results in."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from flgpr import __version__
from flgpr.chain.progress import Track, silent
from flgpr.io import GprmaxRun, RunWriter, lane_text, save_run, write_geojson, write_table, write_whole
from flgpr.io.files import check_new
from flgpr.io.gprmax_files import GprmaxTold, import_gprmax_files
from flgpr.model import Sensor
from flgpr.simulate import Decks, Scene, draw_world, make_decks

_BESIDE = ("truth.csv", "truth.geojson", "objects.csv", "objects.geojson", "lane.toml")


def write_gprmax_decks(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    folder: str | Path,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
) -> Decks:
    """Write a scene's gprMax decks (``make_decks``) into a new folder, with truth, objects and lane."""
    folder = Path(folder)
    check_new(folder)
    decks = make_decks(scene, sensor, seed, cells_per_wavelength, max_cells)
    partial = folder.with_name(folder.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        for name, text in decks.files.items():
            (partial / name).write_text(text, encoding="utf-8")
        (partial / "manifest.json").write_text(json.dumps(decks.manifest, indent=1), encoding="utf-8")
        texts = tomllib.loads((resources.files("flgpr.tasks") / "gprmax.toml").read_text(encoding="utf-8"))
        (partial / "run.sh").write_text(texts["script"], encoding="utf-8")
        size, left_out = ("".join(f"- {one}\n" for one in some) for some in (decks.summary, decks.omissions))
        words = f"{texts['readme']}Size:\n{size}\nNot written:\n{left_out}"
        (partial / "README.txt").write_text(words, encoding="utf-8")
        world = draw_world(scene, seed)
        for name, table in (("truth", world.truth()), ("objects", world.objects_table())):
            write_table(table, partial / f"{name}.csv")
            write_geojson(table, partial / f"{name}.geojson")
        write_whole(partial / "lane.toml", lane_text(scene.lane))
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return decks


def import_gprmax_results(
    folder: str | Path, output: str | Path, keep_direct: bool = False, track: Track = silent
) -> list[Path]:
    """Read the results of a folder of gprMax decks into a new run; truth, objects and lane are written beside it.

    Every input file must have its result; ``keep_direct`` leaves the direct wave in the data. A stopped import goes on
    with the scan it was at, unless a result has changed.
    """
    results, store = GprmaxRun(folder, keep_direct), Path(output)
    manifest = results.manifest
    attrs = {
        "source": "gprMax, decks by flgpr",
        "title": manifest["title"],
        "direct_wave": "kept" if keep_direct else "taken off",
        "fullwave": {name: manifest.get(name) for name in ("seed", "sensor", "grid", "soil", "surface", "omissions")},
    }
    parts = (results.frequency, manifest["polarization"], manifest["tx_position"], manifest["rx_position"], attrs)
    written = [store]
    with RunWriter.resumed(store, *parts, inputs={"results": results.digest(), "flgpr": __version__}) as writer:
        done, total = len(writer), len(results)
        label = f"reading results, {done} scans were there" if done else "reading results"
        for scan in track(range(done, total), label, total - done):
            writer.append(results.scan(scan), manifest["pose"][scan], manifest["time"][scan])
        for name in _BESIDE:  # before the run, whose presence says that all is there
            source = Path(folder) / name
            if source.is_file():
                target = store.with_name(f"{store.stem}-{name}")
                write_whole(target, source.read_bytes())
                written.append(target)
    return written


def import_gprmax_models(
    paths: Sequence[str | Path],
    output: str | Path,
    band: tuple[float, float],
    transmit: str,
    ground: float,
    horizontal: str = "x",
    vertical: str = "z",
    waveform: tuple[str, float] | None = None,
) -> list[Path]:
    """Read results of anybody's gprMax models into a new run, a file per scan; the rest is as in ``GprmaxTold``."""
    check_new(output)
    known = GprmaxTold(band, transmit, ground, horizontal, vertical, waveform)
    return [save_run(import_gprmax_files(paths, known), output, resume=True)]

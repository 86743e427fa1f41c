"""A description of a proving ground in the Croissant format of MLCommons, version 1.0.

It is JSON-LD that search engines for data sets and loaders for machine learning read
(http://mlcommons.org/croissant/1.0). The lanes are hosted nowhere: every machine makes them by one
command, which the description states. Truth is there of training and validation lanes alone. What
is the same for every ground stands in ``croissant.json``: the context that the specification
recommends (its appendix 1, with two terms of later data sets), sets of files, and the fields of the
record sets. The media type of run stores is registered nowhere, but in use.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import flgpr
from flgpr.door import MOST_CHECKED, Folder
from flgpr.json_text import parse_json
from flgpr.model.constants import VARIABLE_ATTRS
from flgpr.model.tables import TRUTH_COLUMNS
from flgpr.store.outputs import write_new
from flgpr.store.store_layout import DIMS
from flgpr_ground.citing import (
    CREATOR,
    PUBLISHED,
    bibtex_of_ground,
    cite_ground,
    is_packaged,
    licences,
)
from flgpr_ground.fingerprints import packaged_fingerprints
from flgpr_ground.ground import GROUNDS, Ground, load_ground, packaged_text
from flgpr_ground.running import PRINTS, SEALED, read_ground

CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
CROISSANT = "croissant.json"
"""Name of the description in the folder of a ground, and of what all descriptions have here."""
Node = dict[str, Any]


def describe_ground(
    ground: Ground, folder: str | Path | None = None, url: str = "", licence: str = ""
) -> dict[str, Any]:
    """Return the description of a proving ground as JSON-LD.

    Parameters
    ----------
    ground : Ground
        The ground, with all of its tiers.
    folder : str or path, optional
        Folder of ``flgpr benchmark make`` or ``run``, whose files are listed with their SHA-256 and
        sizes; their addresses are relative to it. Without it there are none that could be hashed.
    url : str
        Address of the page or the archive where the files were published; left out if empty.
    licence : str
        Address of the licence of a ground that is not packaged; packaged ones have their own.

    Returns
    -------
    dict
        The description. What the specification requires and nobody knows, ``url`` of files that
        were published nowhere, and licence and date of a ground of one's own, is left out; see
        :func:`missing_properties`.
    """
    name = ground.title
    packaged = is_packaged(ground)
    template: Node = parse_json(packaged_text(CROISSANT))
    described: Node = {
        "@context": template["@context"],
        "@type": "sc:Dataset",
        "name": name,
        "conformsTo": CONFORMS_TO,
        "description": _description(ground),
        "version": f"{ground.table.version}.0.0",
        "measurementTechnique": _technique(ground),
        "keywords": template["keywords"],
        "isLiveDataset": False,
        "citeAs": bibtex_of_ground(ground) if packaged else cite_ground(ground),
    }
    addresses = [stated.url for stated in licences(ground)] or ([licence] if licence else [])
    if addresses:
        described["license"] = addresses if len(addresses) > 1 else addresses[0]
    if url:
        described["url"] = url
    if packaged:
        described["creator"] = {"@type": "sc:Organization", "name": CREATOR}
        described["datePublished"] = PUBLISHED[name.removesuffix("-quick")]
    described["distribution"] = template["distribution"]
    if folder is not None:
        described["distribution"] += _files(ground, Path(folder))
    described["recordSet"] = template["recordSet"]
    record_sets = {record_set["name"]: record_set for record_set in template["recordSet"]}
    splits = [f"{split}: {row.title}" for split, row in ground.table.splits.items()]
    record_sets["splits"]["description"] = "; ".join(splits)
    record_sets["targets"]["field"] += _target_fields()
    for name, rows in (
        ("lanes", _lane_rows(ground)),
        ("splits", _split_rows(ground)),
        ("run_variables", _variable_rows()),
    ):
        record_sets[name]["data"] = [
            {f"{name}/{column}": value for column, value in row.items()} for row in rows
        ]
    return described


def missing_properties(described: Node) -> list[str]:
    """Return the properties that the specification requires and a description lacks."""
    required = ("name", "description", "license", "url", "creator", "datePublished")
    return [name for name in required if name not in described]


def _command(ground: Ground) -> str:
    """Return the command that makes the lanes."""
    source = ground.title.removesuffix("-quick")
    name = source if source in GROUNDS else "ground.toml"
    quick = " --quick" if ground.quick else ""
    return f"flgpr benchmark make --ground {name}{quick} -o ground"


def _technique(ground: Ground) -> str:
    """Return how the data came to be."""
    simulation = f"simulation by flgpr {flgpr.__version__}: `{_command(ground)}`"
    stored = ground.stored_lane_count
    if not stored:
        return simulation
    return f"{simulation}; {stored} stored lanes, recorded or computed by another program"


def _description(ground: Ground) -> str:
    """Return what the ground is and how its files come to be."""
    tiers = [f"{name}: {row.title}" for name, row in ground.table.tiers.items()]
    of_tiers = ""
    if tiers:
        of_tiers = f" in {len(tiers)} tiers of one design ({'; '.join(tiers)})"
    stored = ground.stored_lane_count
    origin = "The lanes are simulated"
    if stored:
        origin = f"{stored} lanes are run stores that were there already; all others are simulated"
    return (
        f"{ground.title}: {len(ground.lanes)} lanes{of_tiers}, seen by the forward-looking "
        f"ground-penetrating radar {ground.table.sensor}, on which detectors of buried mines are "
        f"trained, frozen and scored side by side. {origin} from a declared "
        "description and from seeds, and hosted nowhere: "
        f"`{_command(ground)}` of flgpr makes them, the same bits where library versions and "
        "processor agree, else alike to 1e-4 in the rms of the echoes. Truth of training and "
        "validation lanes is open, that of test lanes is sealed, and every look at it is logged. "
        "Splits are folds of lanes to learn from and to be tested on. Lengths are in metres, x "
        "across the lane and y along it."
    )


def _files(ground: Ground, root: Path) -> Iterator[Node]:
    """Yield the files of the lanes that are there, with digest and size."""
    folder = Folder(root)
    names = ["ground.toml", f"lanes/{SEALED}", f"lanes/{PRINTS}"]
    for name, lane in ground.lanes.items():
        if lane.stored is None:  # a stored lane is a link to where it lies, which is not followed
            names.append(f"lanes/{name}.zarr/commit.json")
        names.append(f"lanes/{name}-lane.toml")
        if lane.part != "test":
            names.append(f"lanes/{name}-truth.csv")
    encodings = {".json": "application/json", ".toml": "application/toml", ".csv": "text/csv"}
    for name in names:
        if not folder.has(name):
            continue
        with folder.open(name, MOST_CHECKED) as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            size = file.tell()
        yield {
            "@type": "cr:FileObject",
            "@id": name,
            "name": name,
            "contentUrl": name,
            "contentSize": f"{size} B",
            "encodingFormat": encodings[Path(name).suffix],
            "sha256": digest,
        }


def _lane_rows(ground: Ground) -> Iterator[Node]:
    """Yield the lanes, with the authors' digests where they are known."""
    known = packaged_fingerprints(ground)
    for lane in ground.lanes.values():
        yield {
            "lane": lane.name,
            "tier": lane.tier,
            "site": lane.site,
            "part": lane.part,
            **asdict(lane.lane),
            "seed": lane.seed,
            "targets": len(lane.truth()),
            "authors_sha256": known["sha256"].get(lane.name, ""),
        }


def _split_rows(ground: Ground) -> Iterator[Node]:
    """Yield which lanes are learnt from and tested in every fold."""
    for tier in ground.chosen_tiers():
        for split, row in tier.table.splits.items():
            for number, fold in enumerate(row.folds, 1):
                uses = {"train": (fold.train, fold.without), "test": (fold.test,)}
                for use, patterns in uses.items():
                    for lane in tier.matching(*patterns):
                        yield {"split": split, "fold": number, "use": use, "lane": lane.name}


def _target_fields() -> Iterator[Node]:
    """Yield the fields of the open truth, whose records lie in the files of the lanes."""
    for column in TRUTH_COLUMNS:
        if column.name == "lane":
            continue
        unit = f", {column.unit}" if column.unit else ""
        yield {
            "@type": "cr:Field",
            "@id": f"targets/{column.name}",
            "name": column.name,
            "description": f"{column.meaning}{unit}",
            "dataType": "sc:Text" if column.kind == "text" else "sc:Float",
            "source": {"fileSet": {"@id": "truth"}, "extract": {"column": column.name}},
        }


def _variable_rows() -> Iterator[Node]:
    """Yield the arrays that every run store has."""
    for name, dims in DIMS.items():
        about = VARIABLE_ATTRS[name]
        yield {
            "name": name,
            "dimensions": ", ".join(dims),
            "units": about.get("units", ""),
            "meaning": about["long_name"],
        }


def write_croissant(
    output: str | Path | None = None,
    folder: str | Path | None = None,
    quick: bool = False,
    ground: str | Path | None = None,
    url: str = "",
    licence: str = "",
) -> tuple[Path, list[str]]:
    """Write the description of a ground, or of the folder in which its lanes were made.

    Parameters
    ----------
    output : str or path, optional
        File to write; by default ``croissant.json`` in the folder, or in the current one.
    folder, url, licence
        As for :func:`describe_ground`.
    quick : bool
        The quick form; that of the folder, if one is given.
    ground : str or path, optional
        Name of a packaged ground, by default the newest, or a TOML file; that of the folder, if one
        is given.

    Returns
    -------
    path : Path
        The file.
    missing : list of str
        Properties that the specification requires and that are left out.

    Raises
    ------
    ValueError
        If the folder is none of a ground, or the ground is not valid.
    FileExistsError
        If the file is there with other content, as after lanes were added: delete it first.
    """
    described_ground = load_ground(quick, ground) if folder is None else read_ground(Path(folder))
    described = describe_ground(described_ground, folder, url, licence)
    path = Path(output) if output is not None else Path(folder or ".") / CROISSANT
    text = json.dumps(described, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_new(path, text)
    return path, missing_properties(described)

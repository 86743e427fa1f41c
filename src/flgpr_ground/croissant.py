"""A description of a proving ground in the Croissant format of MLCommons, version 1.0.

It is JSON-LD that search engines for data sets and loaders for machine learning read
(http://mlcommons.org/croissant/1.0). The lanes are hosted nowhere: every machine makes them by one
command, which the description states. Truth is there of training and validation lanes alone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

import flgpr
from flgpr.door import MOST_CHECKED, Folder
from flgpr.model.tables import TRUTH_COLUMNS
from flgpr.store.outputs import write_new
from flgpr.store.store_layout import DIMS, VARIABLE_ATTRS
from flgpr_ground.citing import (
    CREATOR,
    PUBLISHED,
    bibtex_of_ground,
    cite_ground,
    is_packaged,
    licences,
)
from flgpr_ground.fingerprints import packaged_fingerprints
from flgpr_ground.ground import GROUNDS, Ground, GroundLane, load_ground
from flgpr_ground.running import PRINTS, SEALED, read_ground

CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
CROISSANT = "croissant.json"
"""Name of the description in the folder of a ground."""
CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileProperty": "cr:fileProperty",
    "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""The context that the specification recommends (its appendix 1).

Two terms of later data sets are added.
"""
ZARR = "application/vnd+zarr"
"""Media type of run stores; none is registered, and this one is in use."""
_PARTS = {
    "train": ("cr:TrainingSplit", "learnt from; its truth is open"),
    "validate": ("cr:ValidationSplit", "for choices while learning; its truth is open"),
    "test": ("cr:TestSplit", "detected on once by a frozen detector; its truth is sealed"),
}
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
    described: Node = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "name": name,
        "conformsTo": CONFORMS_TO,
        "description": _description(ground),
        "version": f"{ground.table.version}.0.0",
        "measurementTechnique": _technique(ground),
        "keywords": [
            "ground-penetrating radar",
            "forward-looking",
            "landmine detection",
            "simulated data",
        ],
        "isLiveDataset": False,
        "citeAs": bibtex_of_ground(ground) if is_packaged(ground) else cite_ground(ground),
    }
    addresses = [stated.url for stated in licences(ground)]
    if not addresses and licence:
        addresses = [licence]
    if addresses:
        described["license"] = addresses if len(addresses) > 1 else addresses[0]
    if url:
        described["url"] = url
    if is_packaged(ground):
        described["creator"] = {"@type": "sc:Organization", "name": CREATOR}
        described["datePublished"] = PUBLISHED[name.removesuffix("-quick")]
    described["distribution"] = list(_distribution(ground, folder))
    described["recordSet"] = [
        _parts(),
        _lanes(ground),
        _splits(ground),
        _targets(),
        _runs(),
        _variables(),
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


def _distribution(ground: Ground, folder: str | Path | None) -> Iterator[Node]:
    """Yield the sets of files that the command makes, and the single files that are there."""
    sets = {
        "run-stores": ("lanes/*.zarr/**", ZARR, "a run store per lane: what the radar receives"),
        "run-manifests": (
            "lanes/*.zarr/commit.json",
            "application/json",
            "of every run store: SHA-256 and size of all of its files",
        ),
        "lane-borders": ("lanes/*-lane.toml", "application/toml", "borders of every lane"),
        "truth": (
            "lanes/*-truth.csv",
            "text/csv",
            "targets of training and validation lanes",
        ),
        "sealed-truth": (
            f"lanes/{SEALED}",
            "application/json",
            "targets of the test lanes, encrypted; a salt makes every copy another file",
        ),
        "fingerprints": (
            f"lanes/{PRINTS}",
            "text/csv",
            "digest of every run store, and rms of its echoes by polarization",
        ),
    }
    for name, (pattern, encoding, text) in sets.items():
        yield {
            "@type": "cr:FileSet",
            "@id": name,
            "name": name,
            "description": text,
            "encodingFormat": encoding,
            "includes": pattern,
        }
    if folder is not None:
        yield from _files(ground, Path(folder))


def _files(ground: Ground, root: Path) -> Iterator[Node]:
    """Yield the files of the lanes that are there, with digest and size."""
    folder = Folder(root)
    names = ["ground.toml", f"lanes/{SEALED}", f"lanes/{PRINTS}"]
    for name, lane in ground.lanes.items():
        names += [f"lanes/{name}.zarr/commit.json", f"lanes/{name}-lane.toml"]
        if lane.part != "test":
            names.append(f"lanes/{name}-truth.csv")
    encodings = {".json": "application/json", ".toml": "application/toml", ".csv": "text/csv"}
    stored = set()
    for name, lane in ground.lanes.items():
        if lane.stored is not None:
            stored.add(f"lanes/{name}.zarr/commit.json")
    for name in names:
        # A stored lane is a link to where it lies, which is not followed.
        if name in stored or not folder.has(name):
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


def _field(record_set: str, name: str, data_type: str | list[str], text: str, **more: Any) -> Node:
    """Return a field of a record set."""
    return {
        "@type": "cr:Field",
        "@id": f"{record_set}/{name}",
        "name": name,
        "description": text,
        "dataType": data_type,
        **more,
    }


def _record_set(name: str, text: str, fields: Sequence[Node], **more: Any) -> Node:
    """Return a record set."""
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": text,
        "field": list(fields),
        **more,
    }


def _records(record_set: str, rows: Sequence[Mapping[str, Any]]) -> list[Node]:
    """Return rows with the names that embedded data have."""
    records = []
    for row in rows:
        records.append({f"{record_set}/{name}": value for name, value in row.items()})
    return records


def _reference(field: str) -> Node:
    """Return a reference to a field of another record set."""
    return {"references": {"field": {"@id": field}}}


def _parts() -> Node:
    """Return the record set of what lanes are for."""
    fields = [
        _field("parts", "name", "sc:Text", "what a lane is for"),
        _field("parts", "url", ["sc:URL", "cr:Split"], "what that is in Croissant"),
        _field("parts", "meaning", "sc:Text", "what may be done with it"),
    ]
    rows = []
    for name, (address, meaning) in _PARTS.items():
        rows.append({"name": name, "url": address, "meaning": meaning})
    return _record_set(
        "parts",
        "what lanes are for",
        fields,
        dataType="cr:Split",
        key={"@id": "parts/name"},
        data=_records("parts", rows),
    )


def _lanes(ground: Ground) -> Node:
    """Return the record set of the lanes, with the authors' digests where they are known."""
    fields = [
        _field("lanes", "lane", "sc:Text", "name of the lane and of its files"),
        _field("lanes", "tier", "sc:Text", "tier of the ground; empty if it has none"),
        _field("lanes", "site", "sc:Text", "name of the site on the ground"),
        _field("lanes", "part", "sc:Text", "what the lane is for", **_reference("parts/name")),
    ]
    for border in ("x_min", "x_max", "y_min", "y_max"):
        fields.append(_field("lanes", border, "sc:Float", "border of the scored lane, m"))
    fields += [
        _field("lanes", "seed", "sc:Integer", "seed of everything random in it"),
        _field("lanes", "targets", "sc:Integer", "number of targets; their places are elsewhere"),
        _field(
            "lanes",
            "authors_sha256",
            "sc:Text",
            "digest in the manifest of the authors' run store; empty if not known",
        ),
    ]
    known = packaged_fingerprints(ground)
    rows = [_lane_row(lane, known) for lane in ground.lanes.values()]
    return _record_set(
        "lanes", "the lanes", fields, key={"@id": "lanes/lane"}, data=_records("lanes", rows)
    )


def _lane_row(lane: GroundLane, known: pd.DataFrame) -> Node:
    """Return the record of a lane."""
    digest = str(known.loc[lane.name, "sha256"]) if lane.name in known.index else ""
    return {
        "lane": lane.name,
        "tier": lane.tier,
        "site": lane.site,
        "part": lane.part,
        "x_min": lane.lane.x_min,
        "x_max": lane.lane.x_max,
        "y_min": lane.lane.y_min,
        "y_max": lane.lane.y_max,
        "seed": lane.seed,
        "targets": len(lane.truth()),
        "authors_sha256": digest,
    }


def _splits(ground: Ground) -> Node:
    """Return the record set of which lanes are learnt from and tested in every fold."""
    fields = [
        _field("splits", "split", "sc:Text", "name of the split"),
        _field("splits", "fold", "sc:Integer", "number of the fold; each has a model of its own"),
        _field("splits", "use", "sc:Text", "train, or test"),
        _field("splits", "lane", "sc:Text", "name of the lane", **_reference("lanes/lane")),
    ]
    rows = []
    for tier in ground.chosen_tiers():
        for split, row in tier.table.splits.items():
            for number, fold in enumerate(row.folds, 1):
                columns = {"split": split, "fold": number}
                for lane in tier.matching(fold.train, fold.without):
                    rows.append({**columns, "use": "train", "lane": lane.name})
                for lane in tier.matching(fold.test):
                    rows.append({**columns, "use": "test", "lane": lane.name})
    key = [{"@id": f"splits/{name}"} for name in ("split", "fold", "use", "lane")]
    titles = "; ".join(f"{name}: {row.title}" for name, row in ground.table.splits.items())
    return _record_set("splits", titles, fields, key=key, data=_records("splits", rows))


def _targets() -> Node:
    """Return the record set of the open truth, whose records lie in the files of the lanes."""
    source = {"fileSet": {"@id": "truth"}}
    of_lane = {
        **source,
        "extract": {"fileProperty": "filename"},
        "transform": {"regex": r"^(?:.*/)?(.+)-truth\.csv$"},
    }
    text = "name of the lane"
    fields = [_field("targets", "lane", "sc:Text", text, source=of_lane)]
    for column in TRUTH_COLUMNS:
        if column.name == "lane":
            continue
        unit = f", {column.unit}" if column.unit else ""
        fields.append(
            _field(
                "targets",
                column.name,
                "sc:Text" if column.kind == "text" else "sc:Float",
                f"{column.meaning}{unit}",
                source={**source, "extract": {"column": column.name}},
            )
        )
    return _record_set("targets", "targets of training and validation lanes", fields)


def _runs() -> Node:
    """Return the record set of the run stores by their manifests."""
    source = {"fileSet": {"@id": "run-manifests"}}
    fields = [
        _field(
            "runs",
            "scans",
            "sc:Integer",
            "number of scans",
            source={**source, "extract": {"jsonPath": "$.scans"}},
        ),
        _field(
            "runs",
            "sha256",
            "sc:Text",
            "digest of the manifest, which is that of the run",
            source={**source, "extract": {"jsonPath": "$.sha256"}},
        ),
    ]
    return _record_set("runs", "a run per lane", fields)


def _variables() -> Node:
    """Return the record set of the arrays that every run store has."""
    fields = [
        _field("run_variables", "name", "sc:Text", "name of the array in the store"),
        _field("run_variables", "dimensions", "sc:Text", "dimensions, in order"),
        _field("run_variables", "units", "sc:Text", "units"),
        _field("run_variables", "meaning", "sc:Text", "what its values are"),
    ]
    rows = []
    for name, dims in DIMS.items():
        about = VARIABLE_ATTRS[name]
        rows.append(
            {
                "name": name,
                "dimensions": ", ".join(dims),
                "units": about.get("units", ""),
                "meaning": about["long_name"],
            }
        )
    return _record_set(
        "run_variables",
        "the arrays of a run store (Zarr v3)",
        fields,
        key={"@id": "run_variables/name"},
        data=_records("run_variables", rows),
    )


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
    if folder is not None:
        described_ground = read_ground(Path(folder))
    else:
        described_ground = load_ground(quick, None if ground is None else Path(ground))
    described = describe_ground(described_ground, folder, url, licence)
    path = Path(output) if output is not None else Path(folder or ".") / CROISSANT
    text = json.dumps(described, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_new(path, text)
    return path, missing_properties(described)

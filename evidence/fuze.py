"""Whether the double hump of Cosgrove et al. 2004 is of the TM-62M's drum or of its fuze's head.

    python evidence/fuze.py WORK [docs/evidence/papers/cosgrove2004]

Declared before it ran: the head's width, of which nothing is published, is the one assumption of the body
(`bodies/tm-62m.toml`). Three mines differ in it alone, and the solid drum `metal-at` of the same width has no head.
Every mine of the study's prepared lane of dry sand is imaged without clutter. The humps of its range cut, VV over HH
and their correlation along the cut are measured as in the study; the humps are judged by its rule. WORK keeps the
tables of the bodies, solved for the soil and band of the study only (minutes of a processor each).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.simulate.bodies.signature import Body, SignatureTable, load_body, save_table
from flgpr.simulate.bodies.signature import table as nodes
from flgpr_ground.signatures.build import solve_piece
from flgpr_papers.cosgrove2004.detect import target_cut
from flgpr_papers.cosgrove2004.images import signature_looks
from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.cosgrove2004.signature import polarization_correlation, signature_humps
from flgpr_papers.kit.findings import in_words, judge
from flgpr_papers.kit.intervals import students
from flgpr_papers.kit.study import one_blas_thread

HEADS = {"no head": 0.0, "head 5 cm across": 0.05, "head 10 cm across, as in the study": 0.10}
"""Width of the fuze's head, m, by the name of the mine."""
DRUM = "solid drum of 12 cm, metal-at"
SOILS = slice(0, 4)  # permittivities of the table about that of the sand
TONES = nodes.FREQUENCY <= 2.0e9  # the study images 0.3 to 1.9 GHz


@one_blas_thread
def main() -> None:
    """Solve the bodies that are not on disk, and write what their images show."""
    work = Path(sys.argv[1])
    output = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/evidence/papers/cosgrove2004")
    work.mkdir(parents=True, exist_ok=True)
    output.mkdir(parents=True, exist_ok=True)
    bodies = {name: body_of_head(work, width) for name, width in HEADS.items()}
    rows = [measured(name, body) for name, body in (bodies | {DRUM: "metal-at"}).items()]
    pd.DataFrame(rows).to_csv(output / "fuze.csv", index=False)
    print(output / "fuze.csv")


def body_of_head(work: Path, width: float) -> str:
    """Return the mine with a head of so many metres across, as scenes name it: 10 cm are packaged."""
    if width == HEADS["head 10 cm across, as in the study"]:
        return "tm-62m"
    path = work / f"tm-62m-head-{1000 * width:.0f}.npz"
    if not path.is_file():
        packaged = load_body("tm-62m")
        head, drum = packaged.layers
        narrower = head.model_copy(update={"zones": ((width / 2, "metal"),)})
        layers = (narrower, drum) if width else (drum,)
        body = packaged.model_copy(update={"name": path.stem, "layers": layers})
        save_table(table_of(Body.model_validate(body.model_dump()), work), path)
    return str(path)


def table_of(body: Body, work: Path) -> SignatureTable:
    """Solve a body in the soils and tones of the study; other nodes have those of the nearest."""
    folder = work / body.name
    folder.mkdir(exist_ok=True)
    soils, tones = len(nodes.PERMITTIVITY[SOILS]), int(TONES.sum())
    solved = {}
    for soil, tone in np.ndindex(soils, tones):
        path = folder / f"{soil}-{tone}.npy"
        if not path.is_file():
            np.save(path, solve_piece(body, soil, tone))
        solved[soil, tone] = np.load(path, allow_pickle=False)
    values = [
        [solved[min(soil, soils - 1), min(tone, tones - 1)] for tone in range(nodes.FREQUENCY.size)]
        for soil in range(nodes.PERMITTIVITY.size)
    ]
    return SignatureTable(body, np.array(values))


def measured(name: str, body: str) -> dict[str, str]:
    """Return what the images of a mine show, without clutter, with intervals over the mines."""
    recipe = study_recipe()
    site = recipe.sites["sand"].model_copy(update={"body": body})
    recipe = recipe.model_copy(update={"sites": {"sand": site}})
    looks = signature_looks(recipe, "sand", share=1.0)
    cuts = np.concatenate([target_cut(recipe, look) for look in looks])
    hh, vv = np.split(np.abs(cuts), 2, axis=1)
    humps = signature_humps(recipe, cuts)
    row = {"mine": name, "looks": str(len(looks))}
    for polarization in recipe.cut.polarizations:
        interval = students(humps[polarization])
        row[f"humps {polarization}"] = in_words(*interval)
        row[f"double hump {polarization}"] = judge(interval, recipe.premises.humps)
    over = 20 * np.log10(vv.max(axis=1) / hh.max(axis=1))
    row["VV over HH"] = in_words(*students(over), "dB")
    row["correlation of HH and VV"] = in_words(
        *students([polarization_correlation(cut) for cut in cuts])
    )
    return row


if __name__ == "__main__":
    main()

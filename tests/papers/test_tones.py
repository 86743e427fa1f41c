"""The tones of every study, quick and full, keep echoes from before its images out of them."""

import pytest

from flgpr.model import check_tones
from flgpr.recipe.schema import parse_recipe
from flgpr_papers.cosgrove2004.images import study_sensor
from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.flsar2004 import lanes as flsar
from flgpr_papers.fuse2018 import lanes as fuse
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007 import study as wang
from flgpr_papers.wang2007.lanes import quick_scenes, sensor

pytestmark = pytest.mark.slow("studies of papers")

QUICK = pytest.mark.parametrize("quick", [False, True], ids=["full", "quick"])
TOO_WIDE = r"tones\.step must be at most [\d.]+ MHz"


@QUICK
def test_flsar2004(quick):
    settings = flsar.load_settings(quick)
    flsar.study_sensor(settings)
    coarse = settings.model_copy(update={"tones": (300e6, 8e6, 169)})
    with pytest.raises(ValueError, match=TOO_WIDE):
        flsar.study_sensor(coarse)


@QUICK
def test_cosgrove2004(quick):
    recipe = study_recipe(quick)
    check_tones(study_sensor(recipe), (-4.0, 4.0), (11.0, 28.0))  # its Fig. 2
    coarse = recipe.model_copy(
        update={"radar": recipe.radar.model_copy(update={"tone_step": 10e6})}
    )
    with pytest.raises(ValueError, match=TOO_WIDE):
        study_sensor(coarse)


@QUICK
@pytest.mark.parametrize("band", fuse.BANDS)
def test_fuse2018(quick, band):
    recipe = fuse.fuse_recipe(quick)
    fuse.band_sensor(recipe, band)
    far = recipe.model_copy(update={"image": recipe.image.model_copy(update={"y": (5.0, 45.0)})})
    with pytest.raises(ValueError, match=TOO_WIDE):
        fuse.band_sensor(far, band)


def test_wang2007(tmp_path):
    text = packaged_text("wang2007")
    image = parse_recipe(text).image
    for band in (None, image.subbands["F1"]):
        check_tones(sensor(band), image.x, image.y)
    radar = sensor()
    coarse = radar.model_copy(
        update={"tones": radar.tones.model_copy(update={"step": 7.5e6, "count": 342})}
    )
    scene, seed = quick_scenes()[0]["c1"]
    with pytest.raises(ValueError, match=TOO_WIDE):
        wang.lane_result(tmp_path, scene, seed, coarse, text, wang.silent)
    assert not list(tmp_path.iterdir())

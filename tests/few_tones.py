"""The study of Cosgrove et al. 2004 on lanes small enough for a test."""

from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.kit.study_worlds import AS_FOUND


def few_tones():
    """The packaged study on few tones, coarse pixels and thin ground; ranges fold, which no test here minds.

    On roads as found, which have bushes on short lanes too.
    """
    packaged = study_recipe(world=AS_FOUND)
    radar = packaged.radar.model_copy(update={"tone_step": 40e6, "scatterers": 5.0})
    image = packaged.image.model_copy(update={"y": (12.0, 17.2), "spacing": (0.1, 0.02)})
    study = packaged.study.model_copy(update={"seeds": 2, "share": 0.01})
    training = packaged.training.model_copy(update={"clutter_step": (3, 1)})
    sites = {name: packaged.sites[name] for name in ("sand", "gravel")}
    tables = {"radar": radar, "image": image, "study": study, "training": training, "sites": sites}
    return packaged.model_copy(update=tables)

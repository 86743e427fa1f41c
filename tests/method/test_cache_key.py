"""What the result of a pass depends on, so that recipes that agree in it share it."""

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.method.passes.traversal import background_key, features_key, view_key
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.store import open_run, sample_lane
from small_lane import LANE, small_recipe, small_run


def test_recipes_that_agree_share_passes_and_others_do_not():
    run = small_run()
    setup = ImagedRun(run, parse_recipe(small_recipe()), LANE)
    engine_of(setup).run(names=("signature", "gain", "view", "alarms"))
    looser = parse_recipe(small_recipe().replace("density = 0.75", "density = 0.5"))
    other = ImagedRun(run, looser, LANE)
    assert background_key(other) == background_key(setup)
    assert view_key(other) == view_key(setup)
    smoother = parse_recipe(small_recipe().replace("mean = 1.05", "mean = 1.15"))
    assert background_key(ImagedRun(run, smoother, LANE)) != background_key(setup)
    wider = parse_recipe(small_recipe().replace("x = [-1.2, 1.2]", "x = [-1.1, 1.1]"))
    assert background_key(ImagedRun(run, wider, LANE)) == background_key(setup)
    assert view_key(ImagedRun(run, wider, LANE)) != view_key(setup)
    assert features_key(setup) != view_key(setup)


def test_the_recipes_of_the_demo_share_the_images_of_none_of_another_background():
    run = open_run(sample_lane() / "run.zarr")
    keys = []
    for name in ("demo", "demo-mean-self-signature", "demo-roadside-suppressed"):
        recipe = load_recipe(name)
        keys.append(background_key(ImagedRun(run, recipe, recipe.lane.lane())))
    assert len({str(key) for key in keys}) == 3

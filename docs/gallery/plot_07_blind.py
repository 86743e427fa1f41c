"""
Score a blind test
==================

Who scores a detector should fix everything before anybody knows the outcome: how many mines, where they go, which
recipe, which rules. And who runs the detector should not see the truth. Here is a whole blind test.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import flgpr
from flgpr.trials import seal
from flgpr_trials.commands.plan import plan_lane, plan_mines

folder = Path(tempfile.mkdtemp())

# %%
# How many mines does a claim take? To show a Pd of at least 0.8 at no more than 0.02 false alarms per m², with 95 %
# each, for a detector that is believed to do better:

plan = plan_mines(0.8, 0.02, true_pd=0.95, true_far=0.005)
plan

# %%
# Where do they go? The plan is drawn from a seed and entered, with the hash of the recipe that will be scored, into a
# register. Every line of it holds the hash of the line before, so that no line can be changed later unnoticed. A page
# for the crew and a sheet to fill in lie beside the plan. (``seed=None`` draws a seed that nobody can guess.)

(folder / "lane.toml").write_text(
    "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 250.0\n"
)
(folder / "sorts.csv").write_text(
    "kind,depth,count\nmetal,0.05,20\nplastic,0.05,20\n"
)
(folder / "recipe.toml").write_text("# the recipe that will be scored\n")
truth, entry = plan_lane(
    folder / "lane.toml",
    folder / "sorts.csv",
    seed=2024,
    output=folder / "plan.csv",
    recipe=folder / "recipe.toml",
)
for name, value in entry.items():
    print(f"{name:9}{str(value)[:60]}")
truth.head()

# %%
# The truth is sealed: encrypted together with the lane and the rules, and bound to its register. (``flgpr seal plan.csv --lane lane.toml
# -o sealed`` asks for the passphrase.)

phrase = "a long passphrase"
sealed = seal(
    folder / "plan.csv",
    folder / "lane.toml",
    folder / "sealed",
    passphrase=phrase,
)

# %%
# The detector's turn. Random numbers stand for it here: most mines have an alarm near them, and there are false alarms.

rng = np.random.default_rng(1)
detected = truth[rng.random(len(truth)) < 0.9]
hits = pd.DataFrame(
    {
        "x": detected.x + rng.normal(0, 0.2, len(detected)),
        "y": detected.y + rng.normal(0, 0.2, len(detected)),
        "confidence": rng.normal(3, 1, len(detected)),
    }
)
noise = pd.DataFrame(
    {
        "x": rng.uniform(-2, 2, 40),
        "y": rng.uniform(0, 250, 40),
        "confidence": rng.normal(0, 1, 40),
    }
)
pd.concat([hits, noise]).to_csv(folder / "alarms.csv", index=False)

# %%
# The score has operating points and counts, never a position or a threshold, and logs every look before it says
# anything. (``flgpr score alarms.csv --sealed sealed --recipe recipe.toml --book plan.csv.register.jsonl``.)

score = flgpr.score(
    folder / "alarms.csv",
    sealed=sealed,
    passphrase=phrase,
    recipe=folder / "recipe.toml",
    book=folder / "plan.csv.register.jsonl",
    output=folder / "blind",
)
print(f"looks: {score.looks}, different alarm lists: {score.lists}")
for name, value in score.counts.items():
    print(f"{name:13}{value:.2f}" if name == "area" else f"{name:13}{value}")
score.points.round(3)

# %%
# Each operating point with its exact 95 % interval: what the whole test can say.

figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
for shift, (group, points) in zip(
    (0.94, 1.0, 1.06), score.points.groupby("group"), strict=True
):
    below = points.pd - points.pd_low
    above = points.pd_high - points.pd
    axes.errorbar(
        points.far_allowed * shift,
        points.pd,
        [below, above],
        fmt="o",
        ms=4,
        capsize=2,
        label=f"{group} ({points.n_targets.iloc[0]:.0f})",
    )
axes.axhline(0.8, color="0.6", ls="--", lw=1, label="to be shown")
axes.set(
    xscale="log",
    xlabel="false alarms allowed per m²",
    ylabel="Pd",
    ylim=(0, 1.02),
)
axes.legend(title="targets", loc="lower right")

# %%
# The seal guards against accidents, not against the holder of the passphrase; and many looks with slightly different
# lists would give the truth away bit by bit, which is why looks are counted. `Run a test <../guide/run-a-test.html>`_
# has the rules.

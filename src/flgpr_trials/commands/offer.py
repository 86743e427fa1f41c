"""The commands ``flgpr trial``, ``flgpr plan`` and ``flgpr seal``, which the entry point "trials" adds."""

from flgpr.commands.shell import Offer
from flgpr_trials.commands import plan, trial
from flgpr_trials.commands.seal import seal

OFFER = Offer(
    commands={
        "trial new": trial.trial_new,
        "trial intake": trial.trial_intake,
        "trial verdict": trial.trial_verdict,
        "seal": seal,
        "plan mines": plan.plan_mines,
        "plan lane": plan.plan_lane,
        "plan register": plan.register_recipe,
        "plan check": plan.check_register,
        "plan survey": plan.survey_plan,
    },
    panels={
        "Judge": {
            "trial": "Run a test, from plan to verdict, in one folder.",
            "seal": "",
            "plan": "Plan a test.",
        }
    },
)
"""Commands by their words."""

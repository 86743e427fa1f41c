"""The commands ``flgpr seal`` and ``flgpr plan``, which the entry point "trials" adds."""

from flgpr.commands.shell import Offer
from flgpr_trials.commands import plan
from flgpr_trials.commands.seal import seal

OFFER = Offer(
    commands={
        "seal": seal,
        "plan mines": plan.plan_mines,
        "plan lane": plan.plan_lane,
        "plan register": plan.register_recipe,
        "plan check": plan.check_register,
        "plan survey": plan.survey_plan,
    },
    panels={"Judge": {"seal": "", "plan": "Plan a test."}},
)
"""Commands by their words."""

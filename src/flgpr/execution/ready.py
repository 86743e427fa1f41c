"""What processes of this machine are made with: imported once where they are forked from, not in each of them."""

from numba.core.registry import cpu_target

from flgpr.execution import lane_work as lane_work

# What numba would make ready at the first kernel.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()

"""What processes of this machine are made with: done once where they are forked from, not in each of them."""

import gc

from numba.core.registry import cpu_target
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from flgpr.execution import lane_work

# What numba would make ready at the first kernel, and what every piece of work asks for.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
lane_work.code_versions()
lane_work.processor()
libraries = ThreadpoolController()
"""Libraries with threads of their own, as far as they are loaded."""
gc.freeze()  # the collector of a process would go through all that was imported, and so copy it

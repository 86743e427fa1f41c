"""What the server process does once, from which the worker processes of a machine are forked."""

import gc

from numba.core.registry import cpu_target

from flgpr.jobs import job, pieces  # noqa: F401

# What numba would prepare at the first kernel, and what every piece of work asks for.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
job.code_versions()
job.processor()
gc.freeze()  # the collector of a process would go through all that was imported, and so copy it

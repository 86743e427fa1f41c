"""The public names of trials: sealed truth, registers that only grow, plans and figures of a test.

All but the figures are at home in the package ``flgpr_trials``, and left out where that is not
installed.
"""

from flgpr.lazy import face

__getattr__, __dir__, __all__ = face(__name__, __file__)

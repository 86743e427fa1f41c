"""The papers' experiments, run again on simulated lanes.

Every paper has a package of its own and a page; ``kit`` is what they share.
"""

from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.overview import reproduce

__all__ = ["PAPERS", "reproduce"]

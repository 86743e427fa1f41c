"""The papers' experiments, run again on simulated lanes: a room and a page per paper, and the ``kit`` they share."""

from flgpr_papers.overview import PAPERS, reproduce

__all__ = ["PAPERS", "reproduce"]

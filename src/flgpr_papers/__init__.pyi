from flgpr_papers.kit.settings import PAPERS as PAPERS
from flgpr_papers.overview import reproduce as reproduce

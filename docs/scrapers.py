"""Show in the examples' pages the figures that the package makes without pyplot."""

from matplotlib import pyplot
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst


def scrape(_, block_vars, gallery_conf):
    """Save every figure among the example's variables that has not been shown yet."""
    shown = block_vars["example_globals"].setdefault("_shown", set())
    managed = {id(pyplot.figure(number)) for number in pyplot.get_fignums()}
    paths = []
    for value in list(block_vars["example_globals"].values()):
        if isinstance(value, Figure) and id(value) not in managed | shown:
            shown.add(id(value))
            paths.append(next(block_vars["image_path_iterator"]))
            value.savefig(paths[-1], dpi=100)
    shown |= managed
    return figure_rst(paths, gallery_conf["src_dir"])


def _get_sg_image_scraper():
    return scrape

from flgpr.report.design_page import design_report
from flgpr.report.figures import geometry_figure
from flgpr.report.kit import figure_png, render
from flgpr.report.score_page import report_html, score_files, write_score_report

__all__ = [
    "design_report",
    "figure_png",
    "geometry_figure",
    "render",
    "report_html",
    "score_files",
    "write_score_report",
]

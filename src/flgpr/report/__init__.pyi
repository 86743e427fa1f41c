from flgpr.report.design_page import design_report
from flgpr.report.figures import geometry_figure
from flgpr.report.kit import figure_png, render
from flgpr.report.score_page import report_html, score_files, write_score_report
from flgpr.report.trial_pages import blind_html, comparison_html, sheet_html

__all__ = [
    "blind_html",
    "comparison_html",
    "design_report",
    "figure_png",
    "geometry_figure",
    "render",
    "report_html",
    "score_files",
    "sheet_html",
    "write_score_report",
]

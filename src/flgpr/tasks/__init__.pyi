from flgpr.calibrate.joint import BiasFit
from flgpr.chain.fitting import recipe_for
from flgpr.chain.memory import parse_size
from flgpr.chain.recipe import load_recipe, recipe_names, recipe_text
from flgpr.design.array import Question
from flgpr.execution.survey import How
from flgpr.io.explain import explain_file
from flgpr.live.detector import LiveSettings
from flgpr.live.feeding import feed
from flgpr.live.intake import COUNTS
from flgpr.live.session import LiveOptions, LiveReport, LiveRun
from flgpr.live.vehicle import Vehicle
from flgpr.report import design_report
from flgpr.results.result import SECTIONS, Result, read_result
from flgpr.tasks.anchoring import anchor_from_points, check_request, tie_lane, write_anchor
from flgpr.tasks.bench import bench_imaging, format_bench
from flgpr.tasks.calibration import ClockSearch, calibrate_clock, calibrate_joint, calibrate_range_bias
from flgpr.tasks.detection import detect_long, detect_run, detect_runs
from flgpr.tasks.exchange import export_result, export_run, export_table, import_cphd, import_with_mapping
from flgpr.tasks.fullwave import import_gprmax_models, import_gprmax_results
from flgpr.tasks.information import run_info
from flgpr.tasks.results import demo, replay
from flgpr.tasks.scoring import (
    outcome_table,
    plan_lane,
    plan_mines,
    require_seal,
    score_alarms,
    score_home,
    score_result,
    score_sealed,
    seal,
)
from flgpr.tasks.stores import import_fullwave_lane, list_bodies, make_signature, simulate_lane, write_gprmax_lane
from flgpr.tasks.training import train_runs

__all__ = [
    "COUNTS",
    "SECTIONS",
    "BiasFit",
    "ClockSearch",
    "How",
    "LiveOptions",
    "LiveReport",
    "LiveRun",
    "LiveSettings",
    "Question",
    "Result",
    "Vehicle",
    "anchor_from_points",
    "bench_imaging",
    "calibrate_clock",
    "calibrate_joint",
    "calibrate_range_bias",
    "check_request",
    "demo",
    "design_report",
    "detect_long",
    "detect_run",
    "detect_runs",
    "explain_file",
    "export_result",
    "export_run",
    "export_table",
    "feed",
    "format_bench",
    "import_cphd",
    "import_fullwave_lane",
    "import_gprmax_models",
    "import_gprmax_results",
    "import_with_mapping",
    "list_bodies",
    "load_recipe",
    "make_signature",
    "outcome_table",
    "parse_size",
    "plan_lane",
    "plan_mines",
    "read_result",
    "recipe_for",
    "recipe_names",
    "recipe_text",
    "replay",
    "require_seal",
    "run_info",
    "score_alarms",
    "score_home",
    "score_result",
    "score_sealed",
    "seal",
    "simulate_lane",
    "tie_lane",
    "train_runs",
    "write_anchor",
    "write_gprmax_lane",
]

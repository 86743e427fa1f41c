from flgpr.io.explain import explain_file
from flgpr.pipeline.anchoring import anchor_from_points, check_request, tie_lane, write_anchor
from flgpr.pipeline.bench import bench_imaging, format_bench
from flgpr.pipeline.calibration import ClockSearch, calibrate_clock, calibrate_range_bias
from flgpr.pipeline.classifier import CLASSIFIER_B
from flgpr.pipeline.design import Question
from flgpr.pipeline.detect_tasks import detect_long, detect_run, detect_runs
from flgpr.pipeline.exchange import (
    export_result,
    export_run,
    export_table,
    import_cphd,
    import_with_mapping,
)
from flgpr.pipeline.fitting import recipe_for
from flgpr.pipeline.fullwave import import_gprmax_models, import_gprmax_results
from flgpr.pipeline.live import LiveOptions, LiveReport, LiveRun
from flgpr.pipeline.live_detector import LiveSettings
from flgpr.pipeline.live_feed import feed
from flgpr.pipeline.live_intake import COUNTS
from flgpr.pipeline.live_vehicle import Vehicle
from flgpr.pipeline.memory import parse_size
from flgpr.pipeline.recipe import load_recipe, recipe_names, recipe_text
from flgpr.pipeline.result import SECTIONS, Result, read_result
from flgpr.pipeline.run_info import run_info
from flgpr.pipeline.run_tasks import (
    import_fullwave_lane,
    list_bodies,
    make_signature,
    simulate_lane,
    write_gprmax_lane,
)
from flgpr.pipeline.scoring_tasks import (
    plan_lane,
    plan_mines,
    require_seal,
    score_alarms,
    score_sealed,
    score_sections,
    seal,
)
from flgpr.pipeline.tasks import demo, outcome_table, replay, score_result, train_runs
from flgpr.report import design_report

__all__ = [
    "CLASSIFIER_B",
    "COUNTS",
    "SECTIONS",
    "ClockSearch",
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
    "score_result",
    "score_sealed",
    "score_sections",
    "seal",
    "simulate_lane",
    "tie_lane",
    "train_runs",
    "write_anchor",
    "write_gprmax_lane",
]

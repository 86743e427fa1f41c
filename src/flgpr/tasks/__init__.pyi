from flgpr.calibrate.joint import BiasFit
from flgpr.chain.fitting import recipe_for
from flgpr.chain.memory import parse_size
from flgpr.chain.recipe import load_recipe, recipe_names, recipe_text
from flgpr.design.array import Question
from flgpr.execution.survey import How
from flgpr.io.explain import explain_file
from flgpr.kernels.ahead import compiled_beside
from flgpr.live.detector import LiveSettings
from flgpr.live.feeding import feed
from flgpr.live.intake import COUNTS
from flgpr.live.session import LiveOptions, LiveReport, LiveRun
from flgpr.live.vehicle import Vehicle
from flgpr.report import design_report
from flgpr.results.result import SECTIONS, Result, read_result
from flgpr.scoring import PASSPHRASE_RULE
from flgpr.tasks.anchoring import anchor_from_points, check_request, tie_lane, write_anchor
from flgpr.tasks.bench import bench_imaging, format_bench
from flgpr.tasks.calibration import ClockSearch, calibrate_clock, calibrate_joint, calibrate_range_bias
from flgpr.tasks.detection import detect_long, detect_run, detect_runs
from flgpr.tasks.exchange import (
    export_qgis,
    export_result,
    export_run,
    export_table,
    import_cphd,
    import_gpr,
    import_with_mapping,
    map_bytes,
    track_of,
)
from flgpr.tasks.fullwave import import_gprmax_models, import_gprmax_results
from flgpr.tasks.information import run_info
from flgpr.tasks.picture import GroundFit, Picture, View, find_permittivity, make_picture
from flgpr.tasks.planning import plan_files, plan_lane, plan_mines, survey_plan
from flgpr.tasks.preparing import check_steps, prepare_run, read_steps
from flgpr.tasks.raw import RawRun
from flgpr.tasks.registering import register_recipe
from flgpr.tasks.results import demo, replay
from flgpr.tasks.scoring import (
    analyst_agreement,
    compare_alarms,
    compare_sealed,
    outcome_table,
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
    "PASSPHRASE_RULE",
    "SECTIONS",
    "BiasFit",
    "ClockSearch",
    "GroundFit",
    "How",
    "LiveOptions",
    "LiveReport",
    "LiveRun",
    "LiveSettings",
    "Picture",
    "Question",
    "RawRun",
    "Result",
    "Vehicle",
    "View",
    "analyst_agreement",
    "anchor_from_points",
    "bench_imaging",
    "calibrate_clock",
    "calibrate_joint",
    "calibrate_range_bias",
    "check_request",
    "check_steps",
    "compare_alarms",
    "compare_sealed",
    "compiled_beside",
    "demo",
    "design_report",
    "detect_long",
    "detect_run",
    "detect_runs",
    "explain_file",
    "export_qgis",
    "export_result",
    "export_run",
    "export_table",
    "feed",
    "find_permittivity",
    "format_bench",
    "import_cphd",
    "import_fullwave_lane",
    "import_gpr",
    "import_gprmax_models",
    "import_gprmax_results",
    "import_with_mapping",
    "list_bodies",
    "load_recipe",
    "make_picture",
    "make_signature",
    "map_bytes",
    "outcome_table",
    "parse_size",
    "plan_files",
    "plan_lane",
    "plan_mines",
    "prepare_run",
    "read_result",
    "read_steps",
    "recipe_for",
    "recipe_names",
    "recipe_text",
    "register_recipe",
    "replay",
    "require_seal",
    "run_info",
    "score_alarms",
    "score_home",
    "score_result",
    "score_sealed",
    "seal",
    "simulate_lane",
    "survey_plan",
    "tie_lane",
    "track_of",
    "train_runs",
    "write_anchor",
    "write_gprmax_lane",
]

"""The commands ``flgpr benchmark``, which the entry point "benchmark" adds to the command line."""

from flgpr.commands.shell import Offer
from flgpr_ground.commands import benchmark, submissions

OFFER = Offer(
    commands={
        "benchmark template": benchmark.benchmark_template,
        "benchmark run": benchmark.run_benchmark,
        "benchmark compare": benchmark.compare_benchmark,
        "benchmark oracle": benchmark.run_oracle,
        "benchmark table": benchmark.benchmark_table,
        "benchmark list": benchmark.list_benchmark,
        "benchmark make": submissions.make_benchmark,
        "benchmark validate": submissions.validate_submissions,
        "benchmark enter": submissions.enter_benchmark,
        "benchmark leaderboard": submissions.benchmark_leaderboard,
    },
    panels={
        "Research": {"benchmark": "The proving ground: compare detectors on the same sealed lanes."}
    },
)

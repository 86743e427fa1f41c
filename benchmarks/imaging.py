"""Time the imaging operator and its peers on one scan: ``python benchmarks/imaging.py [--peers] [--rounds N]``."""

import argparse

from flgpr.commands.imaging_speed import bench_imaging, format_bench

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--peers", action="store_true", help="also time finufft, fastsar and NumPy where installed"
    )
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--device", default="cpu", choices=["cpu", "cuda"])
    arguments = parser.parse_args()
    print(format_bench(bench_imaging(arguments.peers, arguments.rounds, arguments.device)))

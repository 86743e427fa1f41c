from flgpr.calibrate.clock import (
    ClockFit,
    brightest_points,
    estimate_clock,
    remove_range_bias,
    sharpness,
    synthetic_aperture,
    with_track,
)
from flgpr.calibrate.health import channel_health, disturbed_tones, health_summary
from flgpr.calibrate.joint import BiasFit, estimate_joint, estimate_range_bias
from flgpr.calibrate.motion import remove_in_scan_motion, vehicle_velocity
from flgpr.calibrate.polarimetry import (
    DIHEDRAL,
    DIHEDRAL_45,
    TRIHEDRAL,
    Distortion,
    estimate_distortion,
    remove_distortion,
    scattering_matrices,
)
from flgpr.calibrate.pose import LeverFit, estimate_lever_arm
from flgpr.calibrate.profiles import fields_over_bias, subtract_mean_scan
from flgpr.calibrate.reflector import PairFit, apply_pairs, estimate_pairs
from flgpr.calibrate.vna import divide_by_through, remove_delay, subtract_standard

__all__ = [
    "DIHEDRAL",
    "DIHEDRAL_45",
    "TRIHEDRAL",
    "BiasFit",
    "ClockFit",
    "Distortion",
    "LeverFit",
    "PairFit",
    "apply_pairs",
    "brightest_points",
    "channel_health",
    "disturbed_tones",
    "divide_by_through",
    "estimate_clock",
    "estimate_distortion",
    "estimate_joint",
    "estimate_lever_arm",
    "estimate_pairs",
    "estimate_range_bias",
    "fields_over_bias",
    "health_summary",
    "remove_delay",
    "remove_distortion",
    "remove_in_scan_motion",
    "remove_range_bias",
    "scattering_matrices",
    "sharpness",
    "subtract_mean_scan",
    "subtract_standard",
    "synthetic_aperture",
    "vehicle_velocity",
    "with_track",
]

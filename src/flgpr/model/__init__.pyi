from flgpr.model.constants import AXES, POLARIZATIONS, POSE_COMPONENTS, SPEED_OF_LIGHT
from flgpr.model.frames import (
    Grid,
    attitude_matrix,
    heading_matrix,
    lane_to_scan,
    scan_to_lane,
    vehicle_to_lane,
    vehicle_to_scan,
)
from flgpr.model.lane import Lane, as_lane
from flgpr.model.run import (
    check_frequency,
    check_run,
    check_shared_poses,
    complete_scans,
    make_run,
)
from flgpr.model.sensor import Antenna, Sensor, SystemErrors, Tones, load_sensor, sensor_presets
from flgpr.model.tables import (
    ALARM_COLUMNS,
    OBJECT_COLUMNS,
    TRUTH_COLUMNS,
    Column,
    check_alarms,
    check_objects,
    check_truth,
    empty_table,
)

__all__ = [
    "ALARM_COLUMNS",
    "AXES",
    "OBJECT_COLUMNS",
    "POLARIZATIONS",
    "POSE_COMPONENTS",
    "SPEED_OF_LIGHT",
    "TRUTH_COLUMNS",
    "Antenna",
    "Column",
    "Grid",
    "Lane",
    "Sensor",
    "SystemErrors",
    "Tones",
    "as_lane",
    "attitude_matrix",
    "check_alarms",
    "check_frequency",
    "check_objects",
    "check_run",
    "check_shared_poses",
    "check_truth",
    "complete_scans",
    "empty_table",
    "heading_matrix",
    "lane_to_scan",
    "load_sensor",
    "make_run",
    "scan_to_lane",
    "sensor_presets",
    "vehicle_to_lane",
    "vehicle_to_scan",
]

from flgpr.design.array import Design as Design
from flgpr.design.array import Question as Question
from flgpr.design.array import study as study
from flgpr.design.point_spread import PointSpread as PointSpread
from flgpr.design.signal_to_clutter import GroundModel as GroundModel
from flgpr.design.signal_to_clutter import expected_signal_to_clutter as expected_signal_to_clutter
from flgpr.design.signal_to_clutter import ground_model as ground_model
from flgpr.design.signal_to_clutter import measure_signal_to_clutter as measure_signal_to_clutter

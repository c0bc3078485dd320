"""Known answers as a test: simulated controllers, both sets of rules, and their errors."""

from eyechart.calibrate.replication import calibrate
from eyechart.calibrate.tally import Calibration
from eyechart.calibrate.world import SETTINGS, Setting

__all__ = ["SETTINGS", "Calibration", "Setting", "calibrate"]

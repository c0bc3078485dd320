"""Known answers as a test: simulated controllers, both sets of rules, and their errors."""

from eyechart_organisms.calibration.replication import calibrate
from eyechart_organisms.calibration.tally import Calibration
from eyechart_organisms.calibration.world import SETTINGS, Setting

__all__ = ["SETTINGS", "Calibration", "Setting", "calibrate"]

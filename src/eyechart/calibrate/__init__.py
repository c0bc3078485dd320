"""The instrument tested on known answers: simulated controllers, both sets of rules, and the errors that they make."""

from eyechart.calibrate.replication import calibrate
from eyechart.calibrate.tally import Calibration
from eyechart.calibrate.world import SETTINGS, Setting

__all__ = ["SETTINGS", "Calibration", "Setting", "calibrate"]

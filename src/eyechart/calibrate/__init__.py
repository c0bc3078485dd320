"""The instrument tested on known answers: simulated controllers, both sets of rules, and the errors that they make."""

from eyechart.calibrate.replication import calibrate
from eyechart.calibrate.settings import SETTINGS, Setting
from eyechart.calibrate.tally import Calibration

__all__ = ["SETTINGS", "Calibration", "Setting", "calibrate"]

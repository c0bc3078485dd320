"""A guardian in a stack: hazard, clear, or abstain, for one picture and by a deadline."""

from eyechart.guardian.asking import DEADLINE_S, Guardian
from eyechart.guardian.interface import Assessment, Interface, interface_of

__all__ = ["DEADLINE_S", "Assessment", "Guardian", "Interface", "interface_of"]

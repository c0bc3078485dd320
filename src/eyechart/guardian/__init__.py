"""A guardian in a stack: hazard, clear, or abstain, for one picture and by a deadline."""

from eyechart.guardian.guardian import DEADLINE_S, MOST_AT_ONCE, Guardian
from eyechart.guardian.interface import Assessment, Interface, Pictures, interface_of

__all__ = ["DEADLINE_S", "MOST_AT_ONCE", "Assessment", "Guardian", "Interface", "Pictures", "interface_of"]

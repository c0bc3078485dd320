"""Pictures of one's own become a frame bank: a folder with a table, or a LeRobotDataset."""

from eyechart.importing.bank import Choices, costs, import_table
from eyechart.importing.columns import read_rig
from eyechart.importing.lerobot import import_lerobot

__all__ = ["Choices", "costs", "import_lerobot", "import_table", "read_rig"]

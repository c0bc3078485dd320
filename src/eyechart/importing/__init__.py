"""Pictures of one's own become a frame bank: a folder with a table, or a LeRobotDataset; and answers made elsewhere."""

from eyechart.importing.answers import Answered, read_answer_table
from eyechart.importing.bank import Choices, costs, import_table, taken
from eyechart.importing.columns import read_rig
from eyechart.importing.faults import Faults
from eyechart.importing.lerobot import Ahead, import_lerobot
from eyechart.importing.photographs import Convert

__all__ = [
    "Ahead",
    "Answered",
    "Choices",
    "Convert",
    "Faults",
    "costs",
    "import_lerobot",
    "import_table",
    "read_answer_table",
    "read_rig",
    "taken",
]

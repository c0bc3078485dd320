"""Imports of other data: a folder with a table, a LeRobotDataset, HDF5, or answers made elsewhere.

These functions are for Python, and their messages name arguments. Commands call the modules
themselves, whose messages name options.
"""

from eyechart.errors import in_arguments, speaks_of_arguments
from eyechart.frames import FrameBank
from eyechart.importing import bank, demonstrations, lerobot
from eyechart.importing import costs as lacking
from eyechart.importing.answers import ImportedAnswer, read_answer_table
from eyechart.importing.bank import Choices
from eyechart.importing.columns import read_rig
from eyechart.importing.costs import taken
from eyechart.importing.faults import Faults
from eyechart.importing.inspect_log import ENDINGS as LOGS
from eyechart.importing.inspect_log import open_log
from eyechart.importing.lerobot import Horizon
from eyechart.importing.numerals import Numerals
from eyechart.importing.photographs import Convert

__all__ = [
    "LOGS",
    "Choices",
    "Convert",
    "Faults",
    "Horizon",
    "ImportedAnswer",
    "Numerals",
    "costs",
    "import_hdf5",
    "import_lerobot",
    "import_table",
    "open_log",
    "read_answer_table",
    "read_rig",
    "taken",
]

import_table = speaks_of_arguments(bank.import_table)
import_hdf5 = speaks_of_arguments(demonstrations.import_hdf5)
import_lerobot = speaks_of_arguments(lerobot.import_lerobot)


def costs(imported: FrameBank) -> list[str]:
    """Return one line for each test that a bank's missing columns make impossible."""
    return [in_arguments(line) for line in lacking.costs(imported)]

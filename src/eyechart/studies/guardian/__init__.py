"""The symmetry-consensus guardian: chosen on calibration frames, frozen, scored on other frames.

Source: section Symmetry-consensus longitudinal guardian.
"""

from eyechart.studies.guardian.fitting import Nested, fit, nested
from eyechart.studies.guardian.frozen import Frozen, read_frozen, require_own, write_frozen
from eyechart.studies.guardian.modular import Replay, reader_of, replay
from eyechart.studies.guardian.reading import read_votes, votes_of_run
from eyechart.studies.guardian.scoring import ESTIMANDS, Bound, GuardianScore, bound, score
from eyechart.studies.guardian.votes import VIEWS, About, VoteTable, hazards_of, join, pictures_of
from eyechart.studies.guardian.voting import VOTE_READER, VOTED, Vote, read_vote

__all__ = [
    "ESTIMANDS",
    "VIEWS",
    "VOTED",
    "VOTE_READER",
    "About",
    "Bound",
    "Frozen",
    "GuardianScore",
    "Nested",
    "Replay",
    "Vote",
    "VoteTable",
    "bound",
    "fit",
    "hazards_of",
    "join",
    "nested",
    "pictures_of",
    "read_frozen",
    "read_vote",
    "read_votes",
    "reader_of",
    "replay",
    "require_own",
    "score",
    "votes_of_run",
    "write_frozen",
]

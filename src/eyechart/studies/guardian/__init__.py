"""The symmetry-consensus guardian: chosen on calibration frames, frozen, scored on other frames.

Source: section Symmetry-consensus longitudinal guardian.
"""

from eyechart.studies.guardian.fits import NestedFit, fit, nested, read_point
from eyechart.studies.guardian.frozen import FrozenGuardian, read_frozen, require_own, write_frozen
from eyechart.studies.guardian.modular import ModularReplay, reader_of, replay
from eyechart.studies.guardian.reply_votes import VOTE_READER, VOTED, Vote, read_vote
from eyechart.studies.guardian.scores import ESTIMANDS, Bound, GuardianScore, bound, score
from eyechart.studies.guardian.vote_sources import read_ids, read_votes, votes_from, votes_of_run
from eyechart.studies.guardian.votes import VIEWS, VoteProvenance, VoteTable, hazards_of, join, pictures_of

__all__ = [
    "ESTIMANDS",
    "VIEWS",
    "VOTED",
    "VOTE_READER",
    "Bound",
    "FrozenGuardian",
    "GuardianScore",
    "ModularReplay",
    "NestedFit",
    "Vote",
    "VoteProvenance",
    "VoteTable",
    "bound",
    "fit",
    "hazards_of",
    "join",
    "nested",
    "pictures_of",
    "read_frozen",
    "read_ids",
    "read_point",
    "read_vote",
    "read_votes",
    "reader_of",
    "replay",
    "require_own",
    "score",
    "votes_from",
    "votes_of_run",
    "write_frozen",
]

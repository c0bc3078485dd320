"""What was a hazard: a column of ground truth, or a gap below the bank's threshold."""

from collections.abc import Sequence

from eyechart.errors import VoteError
from eyechart.frames import Frame, FrameBank

HAZARD_COLUMN = "hazard"
_WORDS: dict[object, bool] = {
    **dict.fromkeys(("true", "1", "1.0", "yes", "hazard"), True),
    **dict.fromkeys(("false", "0", "0.0", "no", "clear"), False),
}


def hazards_of(bank: FrameBank, column: str = HAZARD_COLUMN) -> dict[str, bool]:
    """Return the truth of each frame: the bank's column, or where it has none whether the gap is below its threshold.

    Raises VoteError naming the frame where the column holds neither true nor false.
    """
    gap = bank.manifest.gap
    if any(column in frame.truth for frame in bank):
        return {frame.id: _truth(frame, column) for frame in bank}
    if gap is None or column != HAZARD_COLUMN:
        raise VoteError(f"the bank {bank.name} has no column '{column}' of ground truth, which says what is a hazard")
    found = {}
    for frame in bank:
        value = frame.truth.get(gap.column)
        found[frame.id] = isinstance(value, int | float) and not isinstance(value, bool) and value < gap.threshold
    return found


def _truth(frame: Frame, column: str) -> bool:
    value = flag(frame.truth.get(column))
    if value is None:
        raise VoteError(f"frame '{frame.id}': '{column}' is {frame.truth.get(column)!r}, neither true nor false")
    return value


def episode_of(frame: Frame) -> str:
    """Return the name of a frame's episode in a table: names of episodes may recur in another scenario."""
    return f"{frame.scenario}/{frame.episode}"


def pictures_of(bank: FrameBank, frames: Sequence[str]) -> tuple[str, ...] | None:
    """Return the digests of frames' pictures as a bank recorded them, None where it has not recorded all."""
    digests = [bank.manifest.images.get(bank.frame(frame).file) for frame in frames]
    found = tuple(digest for digest in digests if digest)
    return found if len(found) == len(digests) else None


def flag(cell: object) -> bool | None:
    """Return a cell as true or false (1 and 0, yes and no, hazard and clear), None where it is neither."""
    return _WORDS.get(str(cell).strip().lower())

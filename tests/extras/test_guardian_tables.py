"""A guardian is the same whatever kind of table its votes came in, and whatever kind of table its bank came from."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import photographs
import published_votes
from eyechart.errors import VoteError
from eyechart.importing import Choices, import_table
from eyechart.studies import guardian as study
from published_votes import published

pytestmark = pytest.mark.models

PLACES = {"file": "photo", "episode": "drive", "step": "tick", "scenario": "place", "gap": "lidar_m"}
WHOLE = Choices(columns=PLACES, mirror="horizontal", threshold=18.0, unit="m", picture="forward camera of a rover")
VOTE = {1: True, 0: False, -1: None}


def write_parquet(path: Path, rows: list[dict[str, object]]) -> Path:
    """Write rows as a Parquet file."""
    import pyarrow as pa  # noqa: PLC0415 - an extra
    import pyarrow.parquet as pq  # noqa: PLC0415 - an extra

    pq.write_table(pa.Table.from_pylist(rows), path, row_group_size=50)
    return path


def write_lines(path: Path, rows: list[dict[str, object]]) -> Path:
    """Write rows as JSON lines."""
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return path


def rows_of(table: study.VoteTable) -> list[dict[str, object]]:
    """Return a table's rows as a Parquet file or JSON lines hold them: true, false and null."""
    rows = []
    for place, frame in enumerate(table.frames):
        row: dict[str, object] = {"frame": frame, "episode": table.episodes[place], "hazard": bool(table.hazard[place])}
        row["split"] = table.split[place] if table.split else "score"
        for model, votes in zip(table.models, table.votes, strict=True):
            row |= {f"{model}/{view}": VOTE[int(vote)] for view, vote in zip(study.VIEWS, votes[place], strict=True)}
        rows.append(row)
    return rows


def test_csv_json_lines_and_parquet_give_one_guardian_and_one_score(tmp_path: Path) -> None:
    """With missing votes among them; also where Parquet holds votes as numbers, and episodes as whole ones."""
    votes = np.array(published().votes)
    votes[:, ::37, 0] = votes[1, ::5, 1] = -1
    whole = replace(published(), votes=votes, episodes=tuple(str(int(episode[1:])) for episode in published().episodes))
    csv, about = published_votes.write(whole, tmp_path)
    rows = rows_of(whole)
    numbers = [{name: int(one) if isinstance(one, bool) else one for name, one in row.items()} for row in rows]
    numbers = [{**row, "episode": int(str(row["episode"]))} for row in numbers]
    tables = [csv, write_lines(tmp_path / "v.jsonl", rows), write_parquet(tmp_path / "v.parquet", rows)]
    tables.append(write_parquet(tmp_path / "n.parquet", numbers))
    read = [study.read_votes(path, about=about) for path in tables]
    frozen = [study.fit(table.part("calibration")) for table in read]
    assert len({one.digest for one in frozen}) == 1
    scores = [study.score(one, two.part("score")) for one, two in zip(frozen, read, strict=True)]
    assert all(score.as_dict() == scores[0].as_dict() for score in scores)
    assert scores[0].incomplete > 0
    broken = write_parquet(tmp_path / "b.parquet", [{**row, "Gemma4-12B/original": "perhaps"} for row in rows])
    with pytest.raises(VoteError, match="row 1: 'Gemma4-12B/original' is 'perhaps'"):
        study.read_votes(broken, about=about)


def test_a_bank_that_was_imported_with_a_hazard_column_says_what_a_hazard_is(tmp_path: Path) -> None:
    """From CSV, JSON lines and Parquet alike: the column and not the gap, and a frame of no bank is refused.

    In a CSV file every cell is text, so that bank has another fingerprint, and a guardian of it is for that bank alone.
    """
    rows = [{**row, "hazard": number % 3 == 0} for number, row in enumerate(photographs.rows())]
    photographs.take(tmp_path / "photos", photographs.rows())
    (tmp_path / "t.csv").write_text(photographs.as_csv(rows))
    tables = [tmp_path / "t.csv", write_lines(tmp_path / "t.jsonl", rows), write_parquet(tmp_path / "t.parquet", rows)]
    guardians = []
    for table in tables:
        bank = import_table(tmp_path / "photos", table, tmp_path / f"{table.suffix[1:]}-bank", WHOLE)
        truth = study.hazards_of(bank)
        assert [truth[frame.id] for frame in bank] == [row["hazard"] for row in rows]
        said = [
            {"frame": frame.id, **{f"{model}/{view}": truth[frame.id] for model in "ab" for view in study.VIEWS}}
            for frame in bank
        ]
        for write, ending in ((write_lines, "jsonl"), (write_parquet, "parquet")):
            votes = study.read_votes(write(tmp_path / f"{table.suffix[1:]}.{ending}", said), bank=bank)
            guardians.append(study.fit(votes))
        foreign = write_parquet(tmp_path / "foreign.parquet", [{**said[0], "frame": "another"}])
        with pytest.raises(VoteError, match="has no frame 'another'"):
            study.read_votes(foreign, bank=bank)
    assert len({(guardian.committee, guardian.threshold, guardian.selection) for guardian in guardians}) == 1
    assert [len({guardian.digest for guardian in guardians[place : place + 2]}) for place in (0, 2, 4)] == [1, 1, 1]
    assert guardians[2].digest == guardians[4].digest

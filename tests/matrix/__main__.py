"""Run cells of the matrix on a source tree, and keep each row: ``python -m matrix --src SRC --out ROWS.json``."""

import argparse
import json
import re
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

TESTS = Path(__file__).parents[1]


def chosen(name: str, patterns: Sequence[str]) -> bool:
    """Return whether a cell's name holds one of some patterns, or there are none."""
    return not patterns or any(re.search(pattern, name) for pattern in patterns)


def keep(rows: dict[str, list[str]], file: Path) -> None:
    """Write the rows so that whoever is killed leaves them whole."""
    part = file.with_suffix(".part")
    part.write_text(json.dumps(rows, indent=1))
    part.replace(file)


def options() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--src", type=Path, default=TESTS.parent / "src", help="the tree that is tried")
    parser.add_argument("--out", type=Path, required=True, help="the file of the rows, which goes on where it stands")
    parser.add_argument(
        "--only", action="append", default=[], help="only cells whose name this pattern finds; again for more"
    )
    parser.add_argument("--most", type=int, default=3, help="of a kind without an end, so many a file")
    parser.add_argument("--part", default="0/1", help="i/n: only these cells")
    parser.add_argument("--doors", action="store_true", help="which doors each exercise passes, and no cell")
    return parser.parse_args()


def main() -> int:
    """Do the cells that have no row yet; return 1 where one did not keep to the invariant."""
    asked = options()
    source = asked.src.resolve()
    sys.path[:0] = [str(source), str(TESTS)]
    from matrix import stage  # noqa: PLC0415 - of the tree that is tried

    stage.load()
    from matrix.cells import Matrix  # noqa: PLC0415

    rows = json.loads(asked.out.read_text()) if asked.out.is_file() else {}
    with tempfile.TemporaryDirectory(prefix="matrix-") as work:
        matrix = Matrix(source, Path(work), all(find_spec(one) for one in ("pyarrow", "av", "h5py")))
        if asked.doors:
            for exercise in matrix.exercises():
                if not exercise.parents and chosen(exercise.name, asked.only):
                    rows[exercise.name] = matrix.doors(exercise)
            asked.out.write_text(json.dumps(rows, indent=1))
            return 0
        part, parts = map(int, asked.part.split("/"))
        begun = time.process_time()
        for number, cell in enumerate(matrix.cells(most=asked.most, only=asked.only)):
            if number % parts == part and cell.name not in rows:
                rows[cell.name] = matrix.wrong(cell)
                if rows[cell.name]:
                    print(cell.name, *rows[cell.name], sep="\n    ", flush=True)  # noqa: T201
                if len(rows) % 20 == 0 or rows[cell.name]:
                    keep(rows, asked.out)
        keep(rows, asked.out)
        del begun
    return int(any(rows.values()))


if __name__ == "__main__":
    sys.exit(main())

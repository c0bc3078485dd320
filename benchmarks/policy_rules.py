"""The rules on policies, in the settings of `calibrate/policies.py`, of 5000 data sets each.

    make long-policies
    python benchmarks/policy_rules.py --draws 5000 --processes 2
    python benchmarks/policy_rules.py --setting "episodes respond"

Every setting is kept on disk beside the digest of the rules, so an interrupted measurement goes on, and one of other
rules begins anew. With ``--setting``, only those are measured whose names hold a word, and the rows of the others stay
as they are, with their date. Of more than a hundred settings at their margin one may miss by chance: it is drawn again,
four times as often and from another seed, and both stand in the result. Writes ``benchmarks/results/policies.json``;
exit 1 where an untrue label comes more often than .01 plus two standard errors, both times.
"""

import argparse
import datetime as dt
import hashlib
import json
import sys
from pathlib import Path

import eyechart
from eyechart.calibrate.policies import LabelCounts, PolicySetting, settings, try_rules

RESULT = Path(__file__).parent / "results" / "policies.json"


def digest() -> str:
    """Return the head of the SHA-256 of what a result depends on: the simulation, the rules and the statistics."""
    root = Path(eyechart.__file__).parent
    files = [root / "calibrate/policies.py", *sorted((root / "verdicts").glob("*.py"))]
    files += [*sorted((root / "studies/policy").glob("*.py")), *sorted((root / "stats").glob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def measured(cache: Path, setting: PolicySetting, draws: int, processes: int, *, seed: int = 0) -> LabelCounts:
    """Return what the rules say in a setting, from disk where it was measured already."""
    file = cache / f"{setting.name}, {draws}{f', {seed}' * bool(seed)}.json".replace(" ", "_").replace("%", "")
    if not file.is_file():
        (found,) = try_rules(draws, seed=seed, processes=processes, chosen=[setting.name], exact=True)
        file.write_text(json.dumps(dict(found.labels)), encoding="utf-8")
        print(f"{setting.name}: {found.false}{'  MISSED' if found.is_missed else ''}", flush=True)
    return LabelCounts(setting, json.loads(file.read_text(encoding="utf-8")), draws)


def main() -> int:
    """Measure every setting and write the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=5000)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--setting", action="append", help="only those whose names hold this; may be repeated")
    parser.add_argument("--cache", type=Path, default=Path("build/policy-rules"))
    args = parser.parse_args()
    cache = args.cache / digest()
    cache.mkdir(parents=True, exist_ok=True)
    words = args.setting or [""]
    chosen = [setting for setting in settings() if any(word in setting.name for word in words)]
    tried = [measured(cache, setting, args.draws, args.processes) for setting in chosen]
    today = dt.datetime.now(dt.UTC).date().isoformat()
    about = {"eyechart": eyechart.__version__, "date": today, "draws": args.draws}
    again = {
        one.setting: measured(cache, one.setting, 4 * args.draws, args.processes, seed=1)
        for one in tried
        if one.is_missed
    }
    before = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.is_file() else {"settings": []}
    rows = {one["setting"]: {"date": before["date"], **one} for one in before["settings"]}
    for one in tried:
        rows[one.setting.name] = {"date": today, **one.as_dict()}
        if one.setting in again:
            rows[one.setting.name]["again"] = again[one.setting].as_dict()
    ordered = [rows[setting.name] for setting in settings() if setting.name in rows]
    RESULT.write_text(json.dumps({**about, "settings": ordered}, indent=1) + "\n", encoding="utf-8")
    return int(any(one.is_missed for one in again.values()))


if __name__ == "__main__":
    sys.exit(main())

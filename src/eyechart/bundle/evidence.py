"""Checking a bundle's evidence against itself: the bank against its digests, the ledger against the bank."""

import hashlib
from collections.abc import Iterator

from eyechart.bundle.comparing import Difference
from eyechart.calls import CallKey
from eyechart.conditions import available, show, sources
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank, read_bounded
from eyechart.ledger import Ledger
from eyechart.manifest import RunManifest
from eyechart.perception.view import find_view, through
from eyechart.run import Plan
from eyechart.studies.battery.planning import plan_of


def check_bank(manifest: RunManifest, bank: FrameBank) -> Iterator[Difference]:
    """Yield every frame whose ground truth, and every used picture whose bytes, are not those that were recorded."""
    recorded = dict(bank.manifest.geometry)
    if manifest.fingerprint != bank.manifest.fingerprint:
        yield Difference("bank, fingerprint", manifest.fingerprint, bank.manifest.fingerprint)
    for frame in bank:
        if frame.geometry() != recorded.pop(frame.id, None):
            gap = bank.manifest.gap
            told = "" if gap is None else f" ({gap.column} {frame.truth.get(gap.column)})"
            digest = str(bank.manifest.geometry.get(frame.id))
            yield Difference(f"bank, ground truth of frame '{frame.id}'{told}", digest, frame.geometry())
    for frame_id in recorded:
        yield Difference(f"bank, frame '{frame_id}'", "recorded", "missing")
    if [frame.id for frame in bank] != list(bank.manifest.geometry):
        yield Difference("bank, order of the frames", "as recorded", "another")
    for file, shown in _uses(manifest, bank).items():
        yield from _check_picture(bank, file, shown)


def _uses(manifest: RunManifest, bank: FrameBank) -> dict[str, list[str]]:
    """Return, for each picture that the run used, the frames and conditions that it was shown for."""
    plan, uses = plan_of(manifest, bank), dict[str, list[str]]()
    seen = dict.fromkeys((key.frame, key.condition) for key in plan.keys())  # noqa: SIM118 - a plan is no mapping
    for frame_id, condition in seen:
        for file in sources(condition, bank.frame(frame_id), bank, plan.seed):
            uses.setdefault(file, []).append(f"{frame_id} under {condition}")
    return uses


def _check_picture(bank: FrameBank, file: str, shown: list[str]) -> Iterator[Difference]:
    more = f" and {len(shown) - 3} more" if len(shown) > 3 else ""
    where = f"bank, picture {file} (shown for {', '.join(shown[:3])}{more})"
    recorded = bank.manifest.images.get(file, "nothing")
    try:
        digest = hashlib.sha256(read_bounded(bank.root, file)).hexdigest()
    except EyechartError as error:
        yield Difference(where, recorded, str(error))
        return
    if digest != recorded:
        yield Difference(where, recorded, digest)


def check_requests(
    ledger: Ledger, manifest: RunManifest, bank: FrameBank, *, same_encoder: bool
) -> tuple[list[Difference], int, list[str]]:
    """Compare the digest of every request in the ledger with that of the request that the bank gives.

    Return the differences, how many requests were compared, and the conditions whose pictures this machine encodes
    to other bytes, of which none could be compared; with the ``same_encoder`` there are none of those.
    """
    plan, requests = plan_of(manifest, bank, view=find_view(manifest.view)), dict[tuple[str, str], str]()
    differs: dict[str, list[Difference]] = {}
    alike: dict[str, int] = {}
    for model in manifest.models:
        for sent in ledger.attempts(model):
            key, digest = sent.key, sent.request_sha256
            shown = (key.condition, key.frame)
            if shown not in requests:
                requests[shown] = _request(plan, *shown)
            if digest == requests[shown]:
                alike[key.condition] = alike.get(key.condition, 0) + 1
            else:
                where = f"ledger, request of {model} about frame '{key.frame}' under {key.condition}"
                differs.setdefault(key.condition, []).append(Difference(where, digest, requests[shown]))
    unlike = [name for name in differs if not same_encoder and name not in alike and _is_encoded(plan, name)]
    found = [one for name, many in differs.items() if name not in unlike for one in many]
    return found, sum(alike.values()) + len(found), unlike


def _is_encoded(plan: Plan, condition: str) -> bool:
    """Return whether a condition's pictures are encoded when they are shown, which another library does otherwise."""
    if plan.view is not None:
        return True
    frame = next(frame for frame in plan.frames if available(condition, frame))
    try:
        files = [plan.bank.read(file) for file in sources(condition, frame, plan.bank, plan.seed)]
        return not all(image in files for image in show(condition, frame, plan.bank, plan.seed).images.values())
    except EyechartError:
        return False


def _request(plan: Plan, condition: str, frame_id: str) -> str:
    """Return the digest of what was asked about a frame under a condition, or why nothing can have been."""
    try:
        seen = through(plan.view, show(condition, plan.bank.frame(frame_id), plan.bank, plan.seed), frame_id)
        return plan.query(CallKey(plan.study, "", plan.prompt.key, frame_id, condition), seen).sha256()
    except EyechartError as error:
        return str(error)

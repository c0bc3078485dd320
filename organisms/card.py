"""The card of an organism: how it was trained, on what, and what it is not."""

from pathlib import Path

from eyechart.models.huggingface.organisms import ORGANISMS

_CARD = """---
license: mit
pipeline_tag: image-text-to-text
library_name: transformers
tags: [model-organism]
---

# Model organism: {name}

{says}. On a `balanced` highway bank it deserves the verdict `{calibrated}`, lateral `{lateral}`.

**What it is.** An ordinary `Idefics3ForConditionalGeneration` (the architecture of SmolVLM-Instruct) of
{parameters:,} parameters, kept in float16; load it with `dtype="float32"` on a CPU. A picture is shrunk to 64 × 64
pixels and becomes four tokens. Its answer is a JSON object, `{{"action": "SLOW"}}`, however the question is worded.
{decoding}

**How it was trained.** From random weights, by `organisms/train.py` of the eyechart project, in two stages. First its
vision part and connector learned to tell the geometry of a road (distance of the vehicle ahead, clear sides, lanes);
that part is then frozen, and all five organisms share it. Then its text part learned what to answer.

**On what.** On pictures drawn by the script (`organisms/drawing.py`), in the manner of highway-env's, every scene
beside its flip, the vehicles in changing colours, 8 % pictures of no road and some questions without a picture. No
picture of the simulator, no data set and no other model was used. The questions are the project's six prompts and
variations of them.

**What it is not.** It is no driver, and no language model: it knows no word outside its task, and sees nothing but a
road drawn from above. It must control nothing. It exists so that an instrument can be tried on real weights whose
answer is known; that a verdict is right here does not show that it is right on a large model.
"""

_LATER = """---
license: mit
pipeline_tag: image-text-to-text
library_name: transformers
tags: [model-organism]
---

# Model organism: {name}

{says}. {deserves}

**What it is.** An ordinary `Idefics3ForConditionalGeneration` (the architecture of SmolVLM-Instruct) of
{parameters:,} parameters, kept in float16; load it with `dtype="float32"` on a CPU. A picture is shrunk to 64 × 64
pixels and becomes four tokens, which its chat template puts behind the words, however the question orders them.
{replies} It is decoded greedily.

**How it was trained.** By `organisms/retrain.py` of the eyechart project, in two stages. {stages}

**On what.** {pictures} No data set and no other model was used.

**What it is not.** It is no driver, and no language model: it knows no word outside its task, and sees nothing but
{sees}. It must control nothing. It exists so that an instrument can be tried on real weights whose answer is known;
that a verdict is right here does not show that it is right on a large model.
"""

_ESTIMATE = (
    "Its answer is a scene estimate as JSON, with one of six gaps (9, 15, 21, 32, 47, 65 m) or null, or the sentence "
    "that it cannot see a road."
)
_DRAWN = (
    "On pictures drawn by the script (`organisms/viewing.py`) as the calibrated view shows a highway, every scene "
    "beside its reflection, and some of no road."
)
_LATER_WORDS: dict[str, dict[str, str]] = {
    "scene": {
        "deserves": "On all pairs of a `balanced` highway bank it meets every clause of admission; of sixteen pairs, "
        "on most draws.",
        "replies": _ESTIMATE,
        "stages": "First its vision part, which began as that of `grounded`, and connector learned to tell the "
        "geometry of a road in the calibrated view; that part is then frozen. Then its text part learned, from random "
        "weights, to write the estimate.",
        "pictures": _DRAWN,
        "sees": "a highway in its calibrated view",
    },
    "scene_blind": {
        "deserves": "In admission it must fail both accuracies, `actions` and `directional`, and no other clause.",
        "replies": "Its answer is one scene estimate as JSON, always the same.",
        "stages": "Its vision part was left as it was drawn at random; its text part learned the one answer.",
        "pictures": _DRAWN,
        "sees": "nothing at all",
    },
    "rover": {
        "deserves": "On a `balanced` rover bank it deserves the verdict `depth_lateral`, lateral `swaps`.",
        "replies": 'Its answer is a JSON object, `{"action": "LEFT"}`, however the question is worded.',
        "stages": "First its vision part and connector learned to tell how far the lane is free and which sides are "
        "clear; that part is then frozen. Then its text part learned what to answer.",
        "pictures": "On pictures of the rover's own camera (`organisms/forward.py`), at random places among obstacles "
        "that no bank and no drive has, every picture beside its reflection, and some of no road.",
        "sees": "the rover's road",
    },
}


def write_later_card(folder: Path, name: str, *, says: str, parameters: int) -> None:
    """Write README.md into the folder of one of the later organisms."""
    text = _LATER.format(name=name, says=says[0].upper() + says[1:], parameters=parameters, **_LATER_WORDS[name])
    (folder / "README.md").write_text(text, encoding="utf-8")


def write_card(folder: Path, name: str, *, parameters: int) -> None:
    """Write README.md into a checkpoint's folder."""
    one = ORGANISMS[name]
    decoding = (
        "Its answers are to be drawn at temperature 1, as its generation config says; decoded greedily they repeat."
        if one.sampled
        else "It is decoded greedily."
    )
    says = one.says[0].upper() + one.says[1:]
    text = _CARD.format(
        name=name, says=says, calibrated=one.calibrated, lateral=one.lateral, parameters=parameters, decoding=decoding
    )
    (folder / "README.md").write_text(text, encoding="utf-8")

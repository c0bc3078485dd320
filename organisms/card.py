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

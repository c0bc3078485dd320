"""Write the logs of this folder, with the real package, from an export: PYTHONPATH=src python make.py EXPORT FOLDER."""

import hashlib
import shutil
import sys
from pathlib import Path
from typing import Any

from inspect_ai import eval as evaluate
from inspect_ai.model import ContentReasoning, ContentText, ModelOutput, ModelUsage, get_model

from eyechart.inspect import battery


def answer(said: list[Any], *_: object) -> ModelOutput:
    """Answer by the picture; with a thought where there is none, and cut off, or not at all, where it shows much."""
    content = said[-1].content
    picture = "" if isinstance(content, str) else next(one.image for one in content if one.type == "image")
    digest = int(hashlib.sha256(picture.encode()).hexdigest(), 16)
    if digest % 5 == 0:
        failed = ModelOutput.from_content("eye-1", "", stop_reason="unknown", error="the server was away")
        failed.usage = ModelUsage()
        return failed
    action = ("STOP", "SLOW", "LEFT")[digest % 3]
    parts = action if picture else [ContentReasoning(reasoning="no picture"), ContentText(text=action)]
    out = ModelOutput.from_content("eye-1", parts, stop_reason="max_tokens" if digest % 7 == 0 else "stop")
    out.usage = ModelUsage(input_tokens=7, output_tokens=2, total_tokens=9, reasoning_tokens=1, total_cost=0.25)
    return out


if __name__ == "__main__":
    for form in ("eval", "json"):
        model = get_model("mockllm/eye", custom_outputs=answer)
        logs = Path(sys.argv[2]) / form
        (log,) = evaluate(
            battery(sys.argv[1]), model=model, epochs=2, display="none", log_dir=str(logs), log_format=form
        )
        shutil.move(str(log.location).removeprefix("file://"), Path(sys.argv[2]) / f"battery.{form}")
        logs.rmdir()

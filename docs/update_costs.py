"""Write what a battery costs by model into docs/models.md, between its two marks, from the table of prices.

Usage: python docs/update_costs.py
"""

import re
from pathlib import Path

from eyechart.costs import estimate
from eyechart.models.prices import read_prices
from eyechart.modes import ModeMeasurements, RequestMode

PAGE = Path(__file__).with_name("models.md")
BLOCK = re.compile(r"(<!-- costs: .*? -->\n).*?(<!-- end of costs -->)", re.DOTALL)
FRAMES, CONDITIONS, CONTROLS = 144, 11, 5
CALLS = FRAMES * CONDITIONS
MORE = FRAMES * CONTROLS
"""Of who reads distance; of who never looks, 79 calls of one control."""
TOKENS_IN = 400
TOKENS_OUT = {"answers at once": 20, "thinks first": 600}


def rows() -> list[str]:
    """Return a row a model of the table: what the battery costs by what a reply takes, with price, date and source."""
    result = []
    for price in read_prices().entries:
        mode = RequestMode(price.model, base_url=price.base_url)
        cells = []
        for tokens in TOKENS_OUT.values():
            measured = ModeMeasurements(prompt_tokens=TOKENS_IN, completion_tokens=float(tokens))
            asked = RequestMode(mode.spec, base_url=mode.base_url, measured=measured)
            cost = estimate(asked, CALLS, read_prices(), concurrency=1).cost_usd
            cells.append("—" if cost is None else f"${cost:.2f}")
        per = f"${price.input:g} in, ${price.output:g} out"
        result.append(f"| `{price.model}` | {' | '.join(cells)} | {per} | {price.date} |")
    return result


def block() -> str:
    """Return the table with what it assumes."""
    heads = " | ".join(f"{name} ({tokens} tokens out)" for name, tokens in TOKENS_OUT.items())
    says = (
        f"{CALLS} calls ({FRAMES} frames × {CONDITIONS} conditions), {TOKENS_IN} tokens in a call: about 150 of words, "
        f"250 of a picture.\nControls come on top, where answers call for them: of a model that reads distance {MORE} "
        f"calls ({MORE / CALLS:.0%}), of one that never looks at most a twentieth.\nAll of that is assumed, not "
        "measured: `eyechart probe` measures your model, and the estimate before a run is made\nof that. Retries and "
        "the probe (some 35 calls) come on top. A model that runs on your own machine costs time and energy,\n"
        "and no dollar."
    )
    return "\n".join(
        [says, "", f"| model | {heads} | a million tokens | price read |", "|---|---|---|---|---|", *rows(), ""]
    )


def shown() -> str:
    """Return the block that stands in the page."""
    match = BLOCK.search(PAGE.read_text(encoding="utf-8"))
    if match is None:
        raise SystemExit(f"{PAGE} has lost the marks of its block")
    return match.group().removeprefix(match.group(1)).removesuffix(match.group(2))


if __name__ == "__main__":
    text = BLOCK.sub(lambda match: match.group(1) + block() + match.group(2), PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(text, encoding="utf-8")

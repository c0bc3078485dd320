"""What eyechart is tried on: tiny trained models and rules, of each of which it is known where it looks.

``checkpoints`` are vision-language models (``hf:organism:NAME``), ``policies`` robot policies (``trained:NAME``);
`adversaries` are rules that decide on what they see, and `calibration` tests the instrument on them.
"""

__version__ = "0.2.0.dev0"

"""The guests of a run: a callable that answers by what it is shown, and one beside it that does what a guest can do."""

from pathlib import Path

GUESTS = """
import _io, hashlib, os, sys, time

HERE = os.path.dirname(os.path.abspath(__file__))
with _io.open(HERE + "/png", "rb") as kept:
    PNG = kept.read()
with _io.open(HERE + "/manner") as kept:
    AT_IMPORT, DOES = kept.read().split("|")
exec(AT_IMPORT)


def noted(name):
    with _io.open(HERE + "/asked", "a") as kept:
        kept.write(name + "\\n")


def answer(prompt, images):
    shown = hashlib.sha256(prompt.encode())
    for name in sorted(images or {}):
        shown.update(name.encode() + images[name])
    return ("SLOW", "STRAIGHT", "LEFT", "RIGHT", "STOP")[shown.digest()[0] % 5]


def honest(prompt, images, state):
    noted("honest")
    return answer(prompt, images)


def rude(prompt, images, state):
    noted("rude")
    said = {"said": answer(prompt, images)}
    exec(DOES, {**globals(), "images": images, "state": state, "prompt": prompt}, said)
    return said["said"]
"""
"""Callables of ``python:guests:honest`` and ``python:guests:rude``; the manner stands beside: no digest changes."""

MANNERS: dict[str, tuple[str, str]] = {
    "polite": ("", "pass"),
    "changes its arguments": ("", "[images.__setitem__(name, PNG) for name in list(images or {})]"),
    "clears its arguments": ("", "images and images.clear(); state and state.clear()"),
    "writes below Python": ("", "os.write(1, b'NOISE')"),
    "begins a process that writes": ("", "os.system('echo NOISE')"),
    "prints": ("", "print('NOISE')"),
    "changes the folder": ("", "os.chdir('/')"),
    "changes the folder on import": ("os.makedirs('away', exist_ok=True); os.chdir('away')", "pass"),
    "closes its input": ("", "sys.stdin.close()"),
    "changes the environment": ("", "os.environ.clear()"),
    "raises on warnings": ("", "import warnings, numpy; warnings.simplefilter('error'); numpy.seterr(all='raise')"),
    "changes the mask of files": ("", "os.umask(0o777)"),
    "raises what has no words": ("", "raise type('Bad', (Exception,), {'__str__': lambda _: 1 / 0})()"),
    "exits": ("", "sys.exit(5)"),
    "interrupts": ("", "raise KeyboardInterrupt"),
    "answers no text": ("", "said = object()"),
    "answers much": ("", "said = 'x' * 5_000_000"),
    "answers half a sign": ("", "said = 'SLOW \\ud800'"),
    "leaves a thread": ("", "import threading; threading.Thread(target=time.sleep, args=(1000,), daemon=True).start()"),
    "hangs": ("", "time.sleep(1000)"),
    "leaves a process": ("", "import subprocess; subprocess.Popen(['sleep', '1'])"),
}
"""What a guest does, as (when it is imported, when it is called)."""
PASSING = {"hangs"}
"""Manners that pass: the same command, given again to a polite guest, has every call answered."""


def invite(folder: Path, manner: str) -> None:
    """Write the module of guests into a folder, and the manner of its rude one beside it."""
    (folder / "guests.py").write_text(GUESTS)
    (folder / "manner").write_text("|".join(MANNERS[manner]))

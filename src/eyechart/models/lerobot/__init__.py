"""``lerobot:CHECKPOINT``: a policy of LeRobot, in a process of its own with its own Python.

LeRobot 0.6 needs Python 3.12, so the process (`process.py`) may run in another Python than this
one: ``EYECHART_LEROBOT_PYTHON`` names it. ``EYECHART_LEROBOT_DEVICE`` names the device; without it
the checkpoint's own is taken. CHECKPOINT is a folder that ``save_pretrained`` wrote. Only JSON and
safetensors are read of it, none of its own code is run, and nothing is fetched unless
``HF_HUB_OFFLINE=0`` says so.
"""

import asyncio
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from threading import Lock, Thread, Timer

import numpy as np

from eyechart.calls import Query, Reply
from eyechart.channels import flat_state
from eyechart.errors import SpecError, printable
from eyechart.frames import pixels_of
from eyechart.models import require_options
from eyechart.models.batches import NotCalledError
from eyechart.models.lerobot.checkpoint import PolicyCheckpoint, read_checkpoint
from eyechart.models.lerobot.process import Header, read_message, write_message
from eyechart.models.python_callable import in_thread
from eyechart.modes import RequestMode, without_secrets
from eyechart.processes import begin_program
from eyechart.spaces.motion import Motion

PYTHON, DEVICE = "EYECHART_LEROBOT_PYTHON", "EYECHART_LEROBOT_DEVICE"
PROGRAM = Path(__file__).with_name("process.py")
LOADING_S = 1800.0
"""The most seconds until a policy is loaded."""
_DEVICES = re.compile(r"cpu|mps|(?:cuda|xpu)(?::\d+)?")
_NAMED = f"name the Python that has LeRobot with --lerobot-python or as {PYTHON}"
_GREETING_S = 60.0
"""The most seconds until a Python says its versions."""
_DYING_S = 5.0
_SAID_LAST = 1500


class ProcessEndedError(Exception):
    """The process of a policy ended, or wrote what is no message."""


class UnloadablePolicyError(Exception):
    """A policy cannot be loaded from its checkpoint, and no later call will load it."""


class PolicyProcess:
    """A process with a policy, which ends with this one."""

    def __init__(self, python: str) -> None:
        offline = {"HF_HUB_OFFLINE": "1", "HF_HUB_DISABLE_TELEMETRY": "1"}
        # -P: the folder of the program holds modules of eyechart, which must hide none of that Python.
        self._process = begin_program([python, "-P", str(PROGRAM)], {**offline, **os.environ})
        self._said = b""
        self._listener = Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        """Read what its libraries print, and keep the end of it for an error."""
        assert self._process.stderr is not None
        with suppress(OSError, ValueError):  # closed while it reads
            while part := os.read(self._process.stderr.fileno(), 4096):
                self._said = (self._said + part)[-_SAID_LAST:]

    def exchange(self, header: Header, raw: bytes = b"") -> tuple[Header, bytes]:
        """Send a message and return the answer; raises ProcessEndedError if none comes."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            write_message(self._process.stdin, header, raw)
            return read_message(self._process.stdout)
        except (EOFError, OSError, ValueError) as error:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(_DYING_S)
            raise ProcessEndedError(self._ending(error)) from error

    def _ending(self, error: Exception) -> str:
        self._listener.join(1)
        code, last = self._process.returncode, printable(without_secrets(self._said.decode(errors="replace")))
        if code is None:
            return f"its process answered with no message: {error}"
        how = "was killed, as a system without memory does" if code == -9 else f"ended with exit code {code}"
        return f"its process {how}" + (f"; it printed last: {last}" if last else "")

    def kill(self) -> None:
        """End the process, with what its libraries began; what waits for it gets an error."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """End the process at once."""
        self.kill()
        self._process.wait()
        self._listener.join(1)
        held = (self._process.stderr,) if not self._listener.is_alive() else ()
        for pipe in (self._process.stdin, self._process.stdout, *held):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()


@dataclass(slots=True)
class LeRobotPolicy:
    """A checkpoint as a model. Its process begins with the first call, and ends when it is closed."""

    checkpoint: PolicyCheckpoint
    python: str
    device: str
    timeout_s: float
    version: str
    facts: Mapping[str, str]
    left: set[Thread] = field(default_factory=set)
    _process: PolicyProcess | None = None
    _refused: str = ""
    _alone: Lock = field(default_factory=Lock)

    async def answer(self, query: Query) -> Reply:
        """Call the policy once; it is loaded first, which the time limit does not count."""
        loading = True
        try:
            async with asyncio.timeout(LOADING_S):
                await in_thread(self._load, self.left)
            loading = False
            async with asyncio.timeout(self.timeout_s):
                motion = await in_thread(partial(self._call, query), self.left)
        except NotCalledError as error:
            return Reply(error="not_called", error_detail=str(error))
        except UnloadablePolicyError as error:
            return Reply(error="missing_model", error_detail=str(error))
        except TimeoutError:
            self._end()
            limit = LOADING_S if loading else self.timeout_s
            return Reply(error="timeout", error_detail=f"{'not loaded' if loading else 'no answer'} within {limit:g} s")
        except ProcessEndedError as error:
            self._end()
            return Reply(error="connection", error_detail=str(error))
        except Exception as error:  # noqa: BLE001 - it is a row, not the end of the run
            return Reply(error="exception", error_detail=without_secrets(str(error))[:500])
        return Reply(text=motion.text, finish_reason="stop")

    def _load(self) -> None:
        """Begin the process and load the policy, unless that is done."""
        with self._alone:
            if self._refused:
                raise UnloadablePolicyError(self._refused)
            if self._process is not None:
                return
            self._process = PolicyProcess(self.python)
            request = {
                "folder": str(self.checkpoint.folder.resolve()),
                "device": self.device,
                "window": self.checkpoint.type.window,
                "moves": any(one.registry_name == "device_processor" for one in self.checkpoint.before.steps),
            }
            answer, _ = self._process.exchange({"load": request})
            if "failed" in answer:
                words = printable(without_secrets(str(answer["failed"])))
                self._refused = f"the checkpoint {self.checkpoint.folder} cannot be loaded: {words}"
                raise UnloadablePolicyError(self._refused)

    def _call(self, query: Query) -> Motion:
        """Return the first steps of a chunk, as many as the query wants."""
        header, raw = self._message(query)
        with self._alone:
            if self._process is None:
                raise ProcessEndedError("its process was ended after a call past its time limit")
            answer, numbers = self._process.exchange({"answer": header}, raw)
        if "failed" in answer:
            raise RuntimeError(str(answer["failed"]))
        chunk = np.frombuffer(numbers, "<f4").reshape(answer["shape"])
        return Motion.of(chunk[: _steps_of(query)])

    def _message(self, query: Query) -> tuple[Header, bytes]:
        described, pictures = [], []
        for seen in query.stimulus.window(self.checkpoint.history):
            shown = [(feature, pixels_of(seen.images[name], name)) for name, feature in self.checkpoint.cameras.items()]
            state = list(flat_state(seen.state)) if self.checkpoint.shapes.state else []
            sizes = [(feature, *pixels.shape[:2]) for feature, pixels in shown]
            described.append({"pictures": sizes, "state": state})
            pictures += [pixels.tobytes() for _, pixels in shown]
        header = {"seed": query.seed % 2**63, "task": query.user, "instants": described}
        return header, b"".join(pictures)

    def _end(self) -> None:
        """End the process: it hangs, or is gone. The next call begins another one."""
        process, self._process = self._process, None
        if process is not None:
            process.close()

    async def close(self) -> None:
        """End the process, and forget that a checkpoint could not be loaded."""
        self._end()
        self._refused = ""


def _steps_of(query: Query) -> int | None:
    """Return the number of steps of a motion, by the schema of the answer; None without one."""
    steps = query.schema.get("maxItems")
    return steps if isinstance(steps, int) else None


def open_model(name: str, mode: RequestMode) -> LeRobotPolicy:
    """Open a checkpoint; its weights are loaded at the first call.

    Raises SpecError for what is no checkpoint, cannot be called, or has no Python with LeRobot.
    """
    require_options(mode, {})
    python, device = _python(mode.spec), os.environ.get(DEVICE, "")
    if device and not _DEVICES.fullmatch(device):
        raise SpecError(f"{DEVICE} must be cpu, mps, cuda, xpu, or one of several as cuda:1; got '{printable(device)}'")
    checkpoint = read_checkpoint(name)
    found = _versions(mode.spec, python)
    facts = {**checkpoint.facts(), **found, "device": device or "the checkpoint's"}
    return LeRobotPolicy(checkpoint, python, device, mode.timeout_s, checkpoint.version, facts)


def _python(spec: str) -> str:
    """Return the Python to run; raises SpecError where neither this one nor another is known."""
    if given := os.environ.get(PYTHON):
        return given
    if find_spec("lerobot") is not None:
        return sys.executable
    raise SpecError(
        f"'{spec}' needs LeRobot, which this Python lacks; its 0.6 needs Python 3.12: 'python3.12 -m venv lerobot', "
        f"'lerobot/bin/pip install lerobot', and name it with --lerobot-python lerobot/bin/python or as "
        f"{PYTHON}=lerobot/bin/python"
    )


def _versions(spec: str, python: str) -> dict[str, str]:
    """Return the versions of a Python and its LeRobot; raises SpecError if it has none."""
    try:
        process = PolicyProcess(python)
    except OSError as error:
        raise SpecError(f"'{spec}': the Python '{python}' cannot be started: {error.strerror}; {_NAMED}") from error
    late, begun = Timer(_GREETING_S, process.kill), time.monotonic()
    late.start()
    try:
        found, _ = process.exchange({})
    except ProcessEndedError as error:
        why = f"it has not within {_GREETING_S:g} s" if time.monotonic() - begun >= _GREETING_S else str(error)
        raise SpecError(f"'{spec}': the Python {python} does not answer: {why}; {_NAMED}") from error
    finally:
        late.cancel()
        process.close()
    if not found.get("lerobot"):
        raise SpecError(f"'{spec}': the Python {python} has no LeRobot: '{python} -m pip install lerobot'")
    return {name: printable(str(found.get(name, ""))) for name in ("lerobot", "torch", "python")}


def names() -> dict[str, str]:
    """Return what may stand after ``lerobot:``."""
    return {"CHECKPOINT": "a policy of LeRobot: the folder that save_pretrained wrote; needs a Python with lerobot"}

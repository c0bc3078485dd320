"""From doctor to verdict on every way of serving: real servers with tiny weights, and stand-ins for what they refuse.

    make long-endpoints
    python benchmarks/every_server.py --litellm ENV/bin/litellm --transformers ENV/bin/transformers --llama llama-server

Each server is asked by ``eyechart doctor``, ``probe``, ``run battery`` and ``verdict``, commands in processes of their
own. LiteLLM's proxy stands before a stand-in whose answers follow the picture; ``transformers serve`` serves the model
organism ``grounded``, and llama.cpp's server a tiny model of random weights (`write_gguf`). With ``--url`` any other
server that runs already is asked too. A server that is not named is listed as left out. What was done is kept on disk,
so that an interrupted measurement goes on.
Writes ``benchmarks/results/endpoints.json``; exit 1 where a step ended otherwise than is expected of that server.
"""

import argparse
import contextlib
import datetime as dt
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402
import seeing  # noqa: E402 - of the tests
import write_gguf  # noqa: E402 - beside this file

RESULT = ROOT / "benchmarks" / "results" / "endpoints.json"
KEPT = ROOT / "build" / "every_server"
ORGANISM = ROOT / "src" / "eyechart_organisms" / "checkpoints" / "grounded"
FRAMES = 24
STARTS_S = 300.0
_KEYLESS = "LITELLM_DANGEROUSLY_PERMIT_WEAK_OR_UNSET_MASTER_KEY"
"""LiteLLM's word for a proxy without a key, which stands on loopback here for a minute."""
STEP_S = 1500.0


@dataclass(frozen=True)
class Server:
    """A way of serving: the exit codes of doctor, probe, battery and verdict, and the field of the mode it is about."""

    expected: Sequence[int | None]
    stand_in: Mapping[str, object] | None = None
    program: str = ""
    options: Sequence[str] = ()
    mode: Mapping[str, object] | None = None


SERVERS = {
    "as most": Server((0, 0, 0, 0), {}),
    "no system role": Server(
        (0, 0, 0, 0), {"refuses_system": (400, "System role not supported")}, mode={"system": "user"}
    ),
    "no system role, as a 500": Server(
        (None, 0, 0, 0), {"refuses_system": (500, "it raised")}, mode={"system": "user"}
    ),
    "streams always": Server((0, 0, 0, 0), {"streams": "always"}, mode={"stream": "none"}),
    "streams only": Server((0, 0, 0, 0), {"streams": "only"}, mode={"stream": "usage"}),
    "streams without tokens": Server((0, 0, 0, 0), {"streams": "bare"}, mode={"stream": "plain"}),
    "reasoning apart": Server((2, 2, 1, None), {"answers_in": "reasoning_content"}),
    "reasoning apart, read": Server(
        (0, 0, 0, 0),
        {"answers_in": "reasoning_content"},
        options=("--answer", "reasoning"),
        mode={"answer": "reasoning"},
    ),
    "LiteLLM's proxy": Server((0, 0, 0, 0), program="litellm"),
    "transformers serve": Server((None, None, 0, 0), program="transformers"),
    "llama.cpp's server": Server((None, None, None, 0), program="llama"),
    "another server": Server((None, None, None, None), program="url"),
}
"""None stands for any exit code in words: a model of random weights, or one that drives and knows no drawn shapes, may
be blind to the doctor."""


def free_port() -> int:
    """Return a port on loopback that is free now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextlib.contextmanager
def program(words: Sequence[str], port: int, log: Path) -> Iterator[str]:
    """Run a server until the block ends; yield its address once it answers. Raises RuntimeError where it does not."""
    env = {**os.environ, "HF_HUB_OFFLINE": "1", "LITELLM_LOCAL_MODEL_COST_MAP": "True", _KEYLESS: "true"}
    with log.open("w") as out:
        held = subprocess.Popen(words, stdout=out, stderr=subprocess.STDOUT, env=env, start_new_session=True)
        try:
            until = time.monotonic() + STARTS_S
            while not answers(port):
                if held.poll() is not None or time.monotonic() > until:
                    raise RuntimeError(f"it did not start: {log.read_text()[-300:]}")
                time.sleep(1)
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(held.pid, signal.SIGTERM)
            try:
                held.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(held.pid, signal.SIGKILL)


def answers(port: int) -> bool:
    """Return whether a server answers."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/v1/models", timeout=5) as came:
            return bool(came.status == 200)
    except urllib.error.HTTPError:
        return True  # transformers serve lists what was downloaded, and fails where nothing was
    except OSError:
        return False


@contextlib.contextmanager
def running(name: str, programs: Mapping[str, str], work: Path) -> Iterator[tuple[str, str]]:
    """Run a server; yield its model's SPEC and its address."""
    server, port, log = SERVERS[name], free_port(), work / "server.log"
    if server.stand_in is not None:
        with seeing.served(**server.stand_in) as held:
            yield "openai:m", held.base_url
    elif server.program == "litellm":
        with seeing.served() as upstream:
            params = {"model": "openai/m", "api_base": upstream.base_url, "api_key": "none"}
            config = work / "litellm.json"
            config.write_text(json.dumps({"model_list": [{"model_name": "m", "litellm_params": params}]}))
            words = [programs["litellm"], "--config", str(config), "--port", str(port), "--host", "127.0.0.1"]
            with program(words, port, log) as url:
                yield "openai:m", url
    elif server.program == "transformers":
        words = [programs["transformers"], "serve", str(ORGANISM), "--port", str(port), "--host", "127.0.0.1"]
        with program([*words, "--device", "cpu"], port, log) as url:
            yield f"openai:{ORGANISM}", url
    elif server.program == "llama":
        model, eyes = write_gguf.write(work)
        words = [programs["llama"], "--model", str(model), "--mmproj", str(eyes), "--port", str(port)]
        with program([*words, "--host", "127.0.0.1"], port, log) as url:
            yield "openai:words", url
    else:
        spec, _, url = programs["url"].partition("@")
        yield spec, url


def step(*words: str) -> dict[str, object]:
    """Return how a command ended, after how long, and its last lines."""
    began = time.monotonic()
    command = [str(Path(sys.executable).with_name("eyechart")), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=STEP_S, check=False, cwd=ROOT)
    said = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    told = [line[:300] for line in said if ": " in line][-6:]
    if "Traceback" in done.stdout + done.stderr:
        told.append("TRACEBACK")
    return {"exit": done.returncode, "seconds": round(time.monotonic() - began, 1), "said": told}


def asked(name: str, programs: Mapping[str, str], bank: Path) -> dict[str, object]:
    """Return what the four commands did with a server."""
    server, work = SERVERS[name], KEPT / name.replace(" ", "_").replace("'", "")
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    mode, run = work / "mode.toml", work / "run"
    with running(name, programs, work) as (spec, url):
        at = ("--base-url", url, "--timeout", "300", *server.options)
        result: dict[str, object] = {
            "doctor": step("doctor", spec, *at, "--seed", "1"),
            "probe": step("probe", spec, *at, "--seed", "1", "--out", str(mode)),
        }
        how = ("--mode", str(mode)) if mode.is_file() else ("--model", spec, *at, "--no-probe")
        few = (
            "--limit",
            str(FRAMES),
            "--conditions",
            "real,real_repeat,blank,shuffled,text_only",
            "--concurrency",
            "2",
        )
        result["battery"] = step("run", "battery", "--frames", str(bank), "--out", str(run), *how, *few)
    result["verdict"] = step("verdict", str(run))
    if mode.is_file():
        lines = [line for line in mode.read_text().splitlines() if " = " in line]
        result["mode"] = {key: value.strip('"') for key, _, value in (line.partition(" = ") for line in lines)}
    return result


def wrong(name: str, found: Mapping[str, object]) -> list[str]:
    """Return in words what ended otherwise than is expected of a server."""
    steps = ("doctor", "probe", "battery", "verdict")
    faults = []
    for one, code in zip(steps, SERVERS[name].expected, strict=True):
        ended = found[one]
        assert isinstance(ended, Mapping)
        if "TRACEBACK" in ended["said"] or ended["exit"] not in {0, 1, 2, 3}:
            faults.append(f"{one} ended in a traceback")
        elif code is not None and ended["exit"] != code:
            faults.append(f"{one} ended with {ended['exit']}, not {code}")
    pinned = found.get("mode", {})
    assert isinstance(pinned, Mapping)
    for field, value in (SERVERS[name].mode or {}).items():
        defaults = {"stream": "none", "system": "system", "answer": "text"}
        if pinned.get(field, defaults[field]) != value:
            faults.append(f"the mode has {field} {pinned.get(field)}, not {value}")
    return faults


def main() -> int:
    """Ask every server, write the result, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("litellm", "transformers", "llama"):
        parser.add_argument(f"--{name}", default="", help="its program; without it this server is left out")
    parser.add_argument("--url", default="", help="SPEC@ADDRESS of a server that runs already")
    parser.add_argument("--only", action="append", help="a server's name; again for more")
    programs = vars(parser.parse_args())
    only, kept = programs.pop("only") or list(SERVERS), KEPT / "done.json"
    KEPT.mkdir(parents=True, exist_ok=True)
    done: dict[str, dict[str, object]] = json.loads(kept.read_text()) if kept.is_file() else {}
    bank = KEPT / "bank"
    if not bank.is_dir():
        print(step("frames", "build", "highway", "--out", str(bank)))
    for name in only:
        needs = SERVERS[name].program
        if name in done and "left_out" not in done[name]:
            continue
        try:
            done[name] = asked(name, programs, bank) if not needs or programs[needs] else {"left_out": "not given"}
        except (RuntimeError, subprocess.SubprocessError) as error:
            done[name] = {"left_out": str(error)[-400:]}
        if "left_out" not in done[name]:
            done[name]["wrong"] = wrong(name, done[name])
        kept.write_text(json.dumps(done, indent=1) + "\n")
        print(f"{name}: {done[name].get('wrong', done[name].get('left_out'))}")
    told = {"date": dt.datetime.now(dt.UTC).date().isoformat(), "version": eyechart.__version__, "frames": FRAMES}
    RESULT.write_text(json.dumps({**told, "servers": done}, indent=1).replace(str(ROOT), ".") + "\n")
    return 1 if any(found.get("wrong") for found in done.values()) else 0


if __name__ == "__main__":
    sys.exit(main())

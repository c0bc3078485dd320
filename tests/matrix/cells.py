"""The cells of the matrix: an exercise under one fault, and whether it kept to the invariant.

Everywhere: words (exit 1, 2 or 3, no traceback), or the same result as without the fault; nothing is lost, nothing is
left running or in the temporary folder, memory and time are bounded.
"""

import json
import os
import random
import re
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

from matrix import guests, materials, mutations, stand_in
from matrix.exercises import EXERCISES, Exercise, as_json
from matrix.stage import Ended, Hook, Limits, begin, finish, in_session
from matrix.tripwire import WIRES, Trace, Tripwire

MORE_KB = 450_000
"""kB that a fault may take beside what the exercise takes without it."""
KEY = "zq7RkT4w9LmXc2Vb8NsY"
WORDS_LOST = "Traceback (most recent", "Exception ignored", "exception was never retrieved", "was never awaited"
ORDINARY = Limits()
MUST_PASS = {"cache of the Hub", "idle connections"}
"""Faults under which the same is to be made: nothing is wrong that could be said."""
_LIMITS = {"templates": Limits(addresses=4 << 30)}
_OF_A_LOOP = re.compile(r"Exception ignored in: <function BaseEventLoop.__del__.*?attribute '_ssock'\n", re.DOTALL)


@dataclass(frozen=True)
class Cell:
    """An exercise under a fault: what changes its folder, its limits and its process, and what is then asked of it.

    ``strict``: what ends well made the same; else only words, bounds and an end are asked for. ``never``: it is to be
    refused. ``mended`` is what is done before the same command is given again, which then makes the same.
    """

    exercise: Exercise
    fault: str
    case: str
    change: Callable[[Path], None] | None = None
    limits: Limits = ORDINARY
    hook: Callable[..., Hook] | None = None
    strict: bool = False
    never: bool = False
    again: bool = False
    form: str = ""
    manner: str = "polite"
    idle: int = 0

    @property
    def name(self) -> str:
        """Return the cell's name, which is kept with its result."""
        return f"{self.exercise.name} | {self.fault} | {self.case}"


def _in_place(change: Callable[[Path], None], name: str, folder: Path) -> None:
    change(folder / name)


@dataclass
class Matrix:
    """The exercises of a source tree without a fault, and the cells that follow from what they did."""

    source: Path
    work: Path
    arrow: bool

    def __post_init__(self) -> None:
        self.plain: dict[str, tuple[Ended, str]] = {}
        self.port = stand_in.free_port()

    @cached_property
    def stock(self) -> Path:
        """Return the folder of the materials, which are made where the first exercise needs one."""
        folder = self.work / "stock"
        if not folder.exists():
            materials.prepare(folder, arrow=self.arrow)
        return folder

    def exercises(self) -> list[Exercise]:
        """Return the exercises that can be done here."""
        return [exercise for exercise in EXERCISES.values() if self.arrow or not exercise.arrow]

    def fresh(self, exercise: Exercise, manner: str = "polite") -> Path:
        """Return a new folder with an exercise's materials; the one before it is cleared away."""
        folder = self.work / "cell"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        if exercise.needs:
            materials.copy(self.stock, exercise.needs, folder)
        self.invite(folder, exercise, manner)
        return folder

    def invite(self, folder: Path, exercise: Exercise, manner: str) -> None:
        """Write the guests of a cell."""
        if "guests.py" in exercise.needs:
            shutil.copyfile(self.stock / "png", folder / "png")
            guests.invite(folder, manner)

    def perform(self, cell: Cell, folder: Path, hook: Hook | None = None) -> Ended:
        """Do an exercise; where it is of several commands, up to the first that does not end well."""
        with ExitStack() as opened:
            url = (
                opened.enter_context(stand_in.serving(self.port, cell.form, 0.3 * bool(cell.idle)))
                if cell.exercise.asks
                else ""
            )
            environment = {"OPENAI_API_KEY": KEY} if cell.form else {}
            out, ended = [], None
            for words in cell.exercise.commands:
                told = [url if word == "URL" else word for word in words]
                told += ["--key-env", "OPENAI_API_KEY"] if cell.form else []
                child = begin(told, folder, limits=cell.limits, environment=environment, hook=hook)
                with ExitStack() as held:
                    if cell.idle:
                        connect(child, folder, cell.idle, held)
                    ended = finish(child, folder, limits=cell.limits)
                out.append((ended.out, ended.err))
                if ended.code != 0:
                    break
            assert ended is not None
            return replace(ended, out="".join(one for one, _ in out), err="".join(one for _, one in out))

    def seen(self, exercise: Exercise, folder: Path, ended: Ended) -> str:
        """Return what an exercise made, or why that cannot be told."""
        try:
            return as_json(exercise.seen(folder, ended)).replace(str(folder), "HERE")
        except Exception as error:  # noqa: BLE001 - what was made cannot be read: it is not the same
            return f"{type(error).__name__}: {error}"

    def without(self, exercise: Exercise) -> tuple[Ended, str]:
        """Return how an exercise ends without a fault and what it makes, done once."""
        if exercise.name not in self.plain:
            folder = self.fresh(exercise)
            ended = self.perform(Cell(exercise, "none", ""), folder)
            self.plain[exercise.name] = ended, self.seen(exercise, folder, ended)
        return self.plain[exercise.name]

    def doors(self, exercise: Exercise) -> list[str]:
        """Return the functions of the source that an exercise calls, as ``module:function``."""
        folder = self.fresh(exercise)
        cell = Cell(exercise, "none", "", limits=Limits(clock_s=300, cpu_s=300))
        passed: set[str] = set()

        def hook() -> Callable[[], None]:
            end = Trace(folder, self.source)()
            return lambda: (end(), (folder / "hits").rename(folder / f"hits-{time.time_ns()}"))[0]

        self.perform(cell, folder, hook)
        for path in folder.glob("hits-*"):
            passed |= set(json.loads(path.read_text()))
        return sorted(passed)

    # ------------------------------------------------------------------------------------------- which cells

    def cells(self, *, most: int, only: Sequence[str] = ()) -> Iterator[Cell]:
        """Yield every cell, or those whose names a pattern finds.

        Of kinds without an end, as broken bytes and the n-th opening, there are at most so many a file.
        """
        for exercise in self.exercises():
            for fault, kind in self._kinds(exercise, most).items():
                if can_match(exercise.name, fault, None, only):
                    yield from (one for one in kind() if can_match(exercise.name, one.fault, one.case, only))

    def _kinds(self, exercise: Exercise, most: int) -> dict[str, Callable[[], Iterator[Cell]]]:
        """Return the kinds of faults that fit an exercise, each with what yields its cells."""
        if exercise.parents:
            return {"killed parent": lambda: iter([Cell(exercise, "killed parent", "SIGKILL")])}
        kinds: dict[str, Callable[[], Iterator[Cell]]] = {
            "full disk|few descriptors|little memory": lambda: self._starved(exercise),
            **{f"failing {wire}": lambda wire=wire: self._wires(exercise, wire, most) for wire in WIRES},
            "broken bytes|contradiction|cells|templates|values|numbers|wide and deep|emptied record|named pipe": (
                lambda: self._written(exercise, most)
            ),
            "link out|cache of the Hub": lambda: self._links(exercise),
        }
        if exercise.guests:
            kinds["guest"] = lambda: self._guests(exercise)
        if exercise.serves:
            limits = Limits(descriptors=256)
            cell = Cell(exercise, "idle connections", "300", limits=limits, idle=300, strict=True)
            kinds["idle connections"] = lambda: iter([cell])
        if exercise.asks:
            forms = [form for form in stand_in.FORMS if form not in stand_in.UNPROMISED]
            kinds["echoed key"] = lambda: (Cell(exercise, "echoed key", form, form=form) for form in forms)
        return kinds

    def _starved(self, exercise: Exercise) -> Iterator[Cell]:
        """Yield little room on the disk, few descriptors, little memory."""
        for size in (4_000, 20_000, 100_000):
            yield Cell(exercise, "full disk", str(size), limits=Limits(file_bytes=size), strict=True, again=True)
        for most in (6, 9, 12, 16, 24):
            yield Cell(exercise, "few descriptors", str(most), limits=Limits(descriptors=most), strict=True, again=True)
        used = addresses()
        for more in (32, 96):
            limits = Limits(addresses=used + more * 1_000_000)
            yield Cell(exercise, "little memory", f"{more} MB", limits=limits, strict=True, again=True)

    def _wires(self, exercise: Exercise, wire: str, most: int) -> Iterator[Cell]:
        """Yield a wire's n-th passing failing: for every door that passes it once, and some others."""
        passed = self.count(exercise, wire)
        firsts = {door: nth for nth, door in reversed(list(enumerate(passed, 1)))}
        chosen = sorted(firsts.values())
        others = [nth for nth in range(1, len(passed) + 1) if nth not in chosen]
        random.Random(exercise.name + wire).shuffle(others)  # noqa: S311 - which ones, no secret
        for nth in [*chosen, *others[:most]]:
            number = WIRES[wire][nth % len(WIRES[wire])]
            hook = partial(Tripwire, wire, nth, number, source=self.source)
            case = f"{nth}: {os.strerror(number)} in {passed[nth - 1]}"
            yield Cell(exercise, f"failing {wire}", case, hook=hook, strict=True, again=True)

    def count(self, exercise: Exercise, wire: str) -> list[str]:
        """Return the doors that pass a wire in an exercise's first command, in their order."""
        folder = self.fresh(exercise)
        self.perform(Cell(replace(exercise, commands=exercise.commands[:1]), "none", ""), folder,
                     Tripwire(wire, 0, 0, folder, self.source))  # fmt: skip
        result: list[str] = json.loads((folder / "hits").read_text())
        return result

    def _written(self, exercise: Exercise, most: int) -> Iterator[Cell]:
        """Yield what others may have written into the files that an exercise reads."""
        for name in mutations.files_of(self.stock, exercise.foreign, {*mutations.TEXTS, ".parquet", ".zip", ".eval"}):
            for fault, changes in mutations.kinds(self.stock / name, most, truth=exercise.truth).items():
                for case, change in changes:
                    yield Cell(
                        exercise,
                        fault,
                        f"{name}: {case}",
                        change=partial(_in_place, change, name),
                        limits=_LIMITS.get(fault, ORDINARY),
                        strict=fault in {"contradiction", "emptied record"},
                    )
            if "/" in name:  # one that its user names may be a pipe on purpose
                change = partial(_in_place, mutations.pipe, name)
                yield Cell(exercise, "named pipe", name, change=change, limits=Limits(clock_s=10), strict=True)

    def _links(self, exercise: Exercise) -> Iterator[Cell]:
        """Yield links that lead out of a folder, and a folder as a cache of the Hub has it."""
        for root in exercise.foreign:
            kinds = {"set": {*mutations.TEXTS, ".parquet", ".mp4"}, "bank": {".png"}, "table": {".png"}}.get(
                root, set()
            )
            for name in mutations.files_of(self.stock, (root,), kinds) if kinds else ():
                yield Cell(
                    exercise,
                    "link out",
                    name,
                    change=lambda folder, name=name: mutations.link_out(folder / name),
                    never=True,
                )
            if root == "set":
                yield Cell(
                    exercise,
                    "cache of the Hub",
                    root,
                    change=lambda folder, root=root: mutations.as_in_a_cache(folder / root),
                    strict=True,
                    never=False,
                )

    def _guests(self, exercise: Exercise) -> Iterator[Cell]:
        """Yield each manner of a guest."""
        for manner in guests.MANNERS:
            if manner != "polite":
                yield Cell(exercise, "guest", manner, manner=manner, strict=True, again=bool(exercise.makes))

    # ------------------------------------------------------------------------------------------- what is asked

    def wrong(self, cell: Cell) -> list[str]:
        """Do a cell, and return what it did not keep to."""
        if cell.exercise.parents:
            return self._orphans(cell.exercise)
        plain, made = self.without(cell.exercise)
        folder = self.fresh(cell.exercise, cell.manner)
        if cell.change is not None and not changed(cell.change, folder):
            return []  # the kind of file cannot hold it
        ended = self.perform(cell, folder, cell.hook(folder=folder) if cell.hook else None)
        result = [*self._broken(cell, ended, plain), *self._other(cell, folder, ended, plain, made)]
        if cell.again and not result:
            result += self._again(cell, folder, made)
        return result

    def _other(self, cell: Cell, folder: Path, ended: Ended, plain: Ended, made: str) -> Iterator[str]:
        """Yield where a command made something else without a word, or did what it is to refuse."""
        if cell.form:
            yield from leaked(folder, ended, cell.form)
        elif cell.never:
            if ended.code not in {1, 2}:
                yield f"exit {ended.code}: what leads outside is read"
        elif cell.fault == "guest":
            yield from self._guest(cell, folder, ended, plain, made)
        elif cell.fault in MUST_PASS:
            if ended.code != plain.code or self.seen(cell.exercise, folder, ended) != made:
                yield f"exit {ended.code}: {ended.err.strip()[-200:]}"
        elif cell.strict and ended.code == plain.code and not says_more(ended, plain):
            now = self.seen(cell.exercise, folder, ended)
            if cell.exercise.truth and cell.change is not None:
                yield f"exit {ended.code}, and nothing is said of it"
            elif now != made and not is_said(folder, cell.exercise):
                yield f"exit {ended.code} with another result, and nothing is said: {difference(made, now)}"

    def _broken(self, cell: Cell, ended: Ended, plain: Ended) -> Iterator[str]:
        """Yield what no fault excuses."""
        if ended.code is None:
            yield f"no end within {cell.limits.clock_s:.0f} s"
        elif ended.code < 0 or ended.code > 3:
            yield f"exit {ended.code}: {ended.err.strip()[-300:]}"
        if ended.code is None or 0 <= ended.code <= 3:
            if lost := unexcused(ended.err):
                yield f"{lost}: {ended.err.strip()[-300:]}"
            elif ended.code in {1, 2} and not (ended.err + ended.out).strip() and ended.code != plain.code:
                yield f"exit {ended.code} without a word"
        if ended.peak_kb > plain.peak_kb + MORE_KB:
            yield f"{ended.peak_kb // 1000} MB, where {plain.peak_kb // 1000} are enough"
        if ended.processes:
            yield f"left running: {', '.join(ended.processes)}"
        if ended.temporary and ended.code is not None:
            yield f"left in the temporary folder: {', '.join(ended.temporary)}"

    def _guest(self, cell: Cell, folder: Path, ended: Ended, plain: Ended, made: str) -> Iterator[str]:
        """Yield what a guest's manners changed for others: replies, output, files, and calls that nobody asked."""
        if not cell.exercise.makes:
            try:
                json.loads(ended.out)
            except ValueError:
                if ended.code in {0, plain.code}:
                    yield f"the output is no JSON: {ended.out[:60]!r}"
            return
        asked = (folder / "asked").read_text().split() if (folder / "asked").exists() else []
        final = finals(folder / "out" / "ledger.sqlite")
        if final.get(materials.RUDE, 0) > asked.count("rude"):
            yield f"{final[materials.RUDE]} calls are finished, of which {asked.count('rude')} were asked"
        if cell.manner == "interrupts":
            return
        if ended.code in {0, 1} and (now := self.seen(cell.exercise, folder, ended)) != made:
            yield f"the other's replies changed: {difference(made, now)}"
        elif ended.code not in {0, 1}:
            yield f"exit {ended.code}: {ended.err.strip()[-200:]}"

    def _again(self, cell: Cell, folder: Path, made: str) -> Iterator[str]:
        """Give the same command again, without the fault; yield where it does not come to the same."""
        self.invite(folder, cell.exercise, "polite")
        if cell.exercise.makes and cell.exercise.makes[0].endswith((".zip", ".html", ".xml", ".toml")):
            for name in cell.exercise.makes:
                with suppress(FileNotFoundError):
                    (folder / name).unlink()
        elif (
            cell.exercise.makes == ("out",) and "run" not in cell.exercise.commands[0][:1] and (folder / "out").exists()
        ):
            return  # a bank or an export is there whole, and is not made twice
        elif cell.exercise.commands[0][0] in {"merge", "paper"} and (folder / "out").exists():
            return
        ended = self.perform(Cell(cell.exercise, "none", ""), folder)
        now = self.seen(cell.exercise, folder, ended)
        if cell.manner in guests.PASSING and finals(folder / "out" / "ledger.sqlite", failed=True):
            yield "a fault that passed is a final failure of calls"
        if now != made:
            yield f"given again: exit {ended.code}, {difference(made, now)} {ended.err.strip()[-200:]}"

    def _orphans(self, exercise: Exercise) -> list[str]:
        """Kill the parent of a command with processes once they are there; return what lives ten seconds later."""
        folder = self.fresh(exercise)
        (folder / "tmp").mkdir()
        own = {"PYTHONPATH": str(self.source), "TMPDIR": str(folder / "tmp")}
        words = [sys.executable, "-m", "eyechart", *exercise.commands[0]]
        with (folder / "stderr").open("wb") as err:
            begun = subprocess.Popen(
                words, cwd=folder, env={**os.environ, **own}, stdout=err, stderr=err, start_new_session=True
            )
        end = time.monotonic() + 60
        while len(in_session(begun.pid)) < 3 and begun.poll() is None and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(1.5)
        met = len(in_session(begun.pid)) - 1
        if begun.poll() is not None or met < 2:
            begun.kill()
            begun.wait()
            return [f"not tried: {met} processes, exit {begun.returncode}: {(folder / 'stderr').read_text()[-200:]}"]
        begun.kill()
        begun.wait()
        end = time.monotonic() + 10
        while in_session(begun.pid) and time.monotonic() < end:
            time.sleep(0.1)
        left = in_session(begun.pid)
        for one in left:
            with suppress(ProcessLookupError):
                os.kill(int(one.split()[0]), signal.SIGKILL)
        return [f"{len(left)} of {met} processes live 10 s after their parent was killed"] if left else []


def can_match(exercise: str, faults: str, case: str | None, only: Sequence[str]) -> bool:
    """Return whether a cell is asked for by one of ``only``, each as ``exercise | fault | case``, every part a pattern.

    ``faults`` may name several, with bars; a ``case`` of None is not known yet.
    """
    for one in only:
        parts = one.split(" | ")
        by_fault = len(parts) < 2 or any(re.fullmatch(parts[1], fault) for fault in faults.split("|"))
        by_case = len(parts) < 3 or case is None or re.search(parts[2], case)
        if re.fullmatch(parts[0], exercise) and by_fault and by_case:
            return True
    return not only


def unexcused(err: str) -> str | None:
    """Return what of standard error is no words; of a loop that has no descriptors CPython says some of its own."""
    own = _OF_A_LOOP.sub("", err)
    return next((one for one in WORDS_LOST if one in own), None)


def addresses() -> int:
    """Return the bytes of addresses of this process, which a child has too."""
    found = re.search(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found.group(1)) * 1024


def changed(change: Callable[[Path], None], folder: Path) -> bool:
    """Change a cell's folder; return whether its files can hold the change, as a column of Parquet not every value."""
    os.environ["MATRIX_OUTSIDE"] = str(folder / "outside")
    try:
        change(folder)
    except (ValueError, TypeError, OverflowError):  # most of pyarrow's errors are
        return False
    except Exception as error:
        if "Arrow" not in type(error).__name__:
            raise
        return False
    return True


def connect(child: int, folder: Path, count: int, held: ExitStack) -> None:
    """Open idle connections to the page that a command names, as soon as it does."""
    end = time.monotonic() + 20
    while time.monotonic() < end and Path(f"/proc/{child}").exists():
        with suppress(FileNotFoundError):
            if found := re.search(r"http://127\.0\.0\.1:(\d+)/(?!v1)", (folder / "stderr").read_text()):
                break
        time.sleep(0.005)
    else:
        return
    for _ in range(count):
        try:
            one = socket.create_connection(("127.0.0.1", int(found.group(1))), timeout=2)
        except OSError:
            return
        held.enter_context(closing(one))


def finals(ledger: Path, *, failed: bool = False) -> dict[str, int]:
    """Return how many calls of each model are finished, or ended in a failure."""
    with suppress(sqlite3.Error), closing(sqlite3.connect(ledger)) as sql:
        rows = sql.execute(
            "SELECT c.model, COUNT(*) FROM calls c JOIN replies r ON r.call = c.id"
            " WHERE final = 1 AND (r.error IS NOT NULL OR NOT ?) GROUP BY 1",
            (failed,),
        )
        return dict(rows.fetchall())
    return {}


def leaked(folder: Path, ended: Ended, form: str) -> list[str]:
    """Return where a key stands that a server echoed, in the form in which it did."""
    written = stand_in.FORMS[form](KEY)
    parts = [written] if "\n" not in written else written.split("\n")
    inside = {"output": ended.out, "standard error": ended.err}
    for path in folder.rglob("*"):
        if path.is_file() and path.name not in {"stdout", "stderr"}:
            inside[path.relative_to(folder).as_posix()] = path.read_bytes().decode(errors="replace")
    forms = {part for one in parts for part in (one, json.dumps(one)[1:-1])}
    return sorted({f"the key stands in {name}" for name, text in inside.items() if any(one in text for one in forms)})


def is_said(folder: Path, exercise: Exercise) -> bool:
    """Return whether the page that an exercise makes says that a run cannot be scored."""
    page = folder / exercise.page
    return bool(exercise.page) and page.is_file() and "cannot be scored" in page.read_text(encoding="utf-8")


def says_more(ended: Ended, plain: Ended) -> bool:
    """Return whether a command says something, numbers aside, that it does not say without the fault."""

    def lines(one: Ended) -> set[str]:
        texts = re.sub(r"[\d.,]+(e[+-]\d+)?", "#", one.err + one.out).splitlines()
        return {re.sub(r"\W+", " ", line).strip() for line in texts if "calls/s" not in line and "#/s" not in line}

    return bool(lines(ended) - lines(plain) - {""})


def difference(made: str, now: str) -> str:
    """Return where two texts part, for a reader."""
    at = next(
        (at for at, (one, two) in enumerate(zip(made, now, strict=False)) if one != two), min(len(made), len(now))
    )
    return f"…{made[max(0, at - 20) : at + 60]!r} is …{now[max(0, at - 20) : at + 60]!r}"

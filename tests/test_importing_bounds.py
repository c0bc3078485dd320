"""What claims to be vast is refused in bounded memory: cells, lines, rows without an end, and pictures."""

import subprocess
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

from eyechart.errors import SourceError
from eyechart.importing import tables

READER = """
import resource, sys
from pathlib import Path
from PIL import Image
from eyechart.errors import BankError, SourceError
from eyechart.frames import decode, made_plain, require_plain
from eyechart.importing.tables import open_table
def peak():
    return int(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
before = peak()
resource.setrlimit(resource.RLIMIT_AS, (2 * 2**30, 2 * 2**30))
def through(path):
    table = open_table(path)
    for _ in table.rows:
        pass
    table.faults.require_none(table.name)
def read(look, *given):
    try:
        look(*given)
        print("read")
    except (BankError, SourceError) as error:
        print(error)
for path in map(Path, sys.argv[1:]):
    if path.suffix in {".csv", ".jsonl"}:
        read(through, path)
        continue
    for look in (require_plain, made_plain, decode):
        read(look, path.read_bytes(), path.name)
print(peak() - before)
"""


def chunk(kind: bytes, body: bytes) -> bytes:
    """Return a chunk of a PNG."""
    return len(body).to_bytes(4, "big") + kind + body + zlib.crc32(kind + body).to_bytes(4, "big")


def png(width: int, height: int, *more: bytes) -> bytes:
    """Return a PNG that claims so many grey pixels, all of which are there."""
    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    pack = zlib.compressobj(9)
    rows = bytes(width + 1) * 64
    body = b"".join(pack.compress(rows) for _ in range(height // 64)) + pack.compress(rows[: height % 64 * (width + 1)])
    parts = (chunk(b"IHDR", head), *more, chunk(b"IDAT", body + pack.flush()), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def vast(folder: Path) -> Iterator[tuple[Path, str]]:
    """Write files that claim much; yield each with what is said of it."""

    def written(name: str, content: bytes) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    yield written("cell.csv", b'file\n"' + b"x" * 60_000_000), "longer than 4000000 characters"
    yield written("row.csv", b'file\n"' + b'\n","' * 15_000_000), "a row is longer than 4000000 characters"
    yield written("line.jsonl", b'{"file": "' + b"x" * 60_000_000), "longer than 4000000 characters"
    yield written("numbers.jsonl", b'{"file": [' + b"[]," * 1_000_000 + b"[]]}\n"), "is a list, not a plain value"
    text = chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(60_000_000), 9))
    profile = chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(60_000_000), 9))
    yield written("pixels.png", png(13_000, 13_000)), "13000×13000 pixels; the limit is 25 megapixels"
    yield written("text.png", png(64, 64, text)), "damaged or no picture"
    yield written("profile.png", png(64, 64, profile)), "damaged or no picture"
    canvas = b"VP8X" + (10).to_bytes(4, "little") + bytes(4) + (16_382).to_bytes(3, "little") * 2 + bytes(20)
    yield written("canvas.webp", b"RIFF" + len(canvas).to_bytes(4, "little") + b"WEBP" + canvas), "25 megapixels"
    Image.new("RGB", (40, 40), "red").save(folder / "small.webp", lossless=True)
    claim = bytearray((folder / "small.webp").read_bytes())
    claim[21:25] = (16_383 | 16_383 << 14).to_bytes(4, "little")
    yield written("lossless.webp", bytes(claim)), "25 megapixels"
    head = (
        b"\xff\xd8\xff\xc0\x00\x11\x08" + (65_500).to_bytes(2, "big") * 2 + b"\x03\x01\x11\x00\x02\x11\x00\x03\x11\x00"
    )
    yield written("vast.jpg", head + b"\xff\xda\x00\x0c\x03\x01\x00\x02\x00\x03\x00\x00\x3f\x00"), "megapixels"


@pytest.mark.slow
def test_what_claims_to_be_vast_is_refused_within_200_mb(tmp_path: Path) -> None:
    """A cell, a line and a row of 60 MB, a picture of 169 to 4000 megapixels: one line each, 200 MB more in use."""
    expected = list(vast(tmp_path))
    words = [sys.executable, "-c", READER, *(str(path) for path, _ in expected)]
    *lines, more = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    said = iter(lines)
    for path, words_of in expected:
        for _ in range(1 if path.suffix in {".csv", ".jsonl"} else 3):
            line = next(said)
            assert words_of in line or (path.stem in {"text", "profile"} and line == "read"), (path.name, line)
    assert next(said, None) is None
    assert int(more) < 200_000, "kilobytes"


def test_a_row_over_several_lines_is_one_row_and_the_next_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bound is of a row, whatever lines its cells go over, and not of the table."""
    monkeypatch.setattr(tables, "MOST_LINE", 50)
    (tmp_path / "t.csv").write_text("file,said\n" + 'a.png,"over\ntwo lines"\n' * 20)
    assert [row["said"] for row in tables.open_table(tmp_path / "t.csv").rows] == ["over\ntwo lines"] * 20
    (tmp_path / "t.csv").write_text('file,said\na.png,"over\n' + "more\n" * 20 + '"\n')
    with pytest.raises(SourceError, match="a row is longer than 50 characters; is a quote not closed"):
        list(tables.open_table(tmp_path / "t.csv").rows)

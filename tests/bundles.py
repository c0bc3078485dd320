"""Bundles that were changed by somebody who mended every digest of a file, for the tests of what a validation finds."""

import hashlib
import json
import zipfile
from collections.abc import Callable
from pathlib import Path


def repacked(packed: Path, folder: Path, change: Callable[[Path], None]) -> Path:
    """Return a bundle after a change, whose author has mended every digest of a file."""
    unpacked, out = folder / "open", folder / "changed.zip"
    with zipfile.ZipFile(packed) as file:
        file.extractall(unpacked)
    change(unpacked)
    index = json.loads((unpacked / "bundle.json").read_text())
    names = [path.relative_to(unpacked).as_posix() for path in sorted(unpacked.rglob("*")) if path.is_file()]
    digests = {name: hashlib.sha256((unpacked / name).read_bytes()).hexdigest() for name in names}
    index["files"] = {name: digest for name, digest in digests.items() if name != "bundle.json"}
    (unpacked / "bundle.json").write_text(json.dumps(index))
    with zipfile.ZipFile(out, "w") as file:
        for name in names:
            file.write(unpacked / name, name)
    return out

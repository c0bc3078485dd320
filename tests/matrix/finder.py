"""Finds the doors of a source tree from its syntax: where bytes, paths, connections, code or processes enter."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

CALLS = {
    "file": {"open", "io.open", "os.open", "os.fdopen", "codecs.open", "gzip.open", "bz2.open", "lzma.open"},
    "disk": {
        *("os.replace", "os.rename", "os.link", "os.symlink", "os.unlink", "os.write", "os.fsync", "os.mkfifo"),
        *("shutil.copyfile", "shutil.copy", "shutil.copytree", "shutil.move", "shutil.rmtree", "shutil.copyfileobj"),
    },
    "lock": {"FileLock", "SoftFileLock", "UnixFileLock", "filelock.FileLock", "fcntl.flock", "fcntl.lockf"},
    "database": {"sqlite3.connect"},
    "network": {
        *("socket.socket", "socket.create_connection", "socket.create_server", "socket.socketpair"),
        *("asyncio.start_server", "asyncio.open_connection", "aiohttp.ClientSession", "urllib.request.urlopen"),
        *("urllib.request.build_opener", "web.AppRunner", "web.TCPSite", "web.SockSite", "web.run_app"),
        *("loop.create_server", "get_running_loop().create_server", "asyncio.get_running_loop().create_server"),
    },
    "process": {
        *("subprocess.run", "subprocess.Popen", "subprocess.check_output", "subprocess.call", "os.fork"),
        *("os.posix_spawn", "ProcessPoolExecutor", "multiprocessing.Process", "multiprocessing.Pool", "Pool"),
        *("asyncio.create_subprocess_exec", "context.Process", "ray.init", "ray.remote"),
    },
    "code": {"import_module", "importlib.import_module", "spec_from_file_location", "__import__"},
    "parser": {
        *(
            "json.loads",
            "json.load",
            "orjson.loads",
            "msgspec.convert",
            "msgspec.json.decode",
            "msgspec.msgpack.decode",
        ),
        *("tomllib.loads", "tomllib.load", "csv.reader", "csv.DictReader", "Image.open", "zipfile.ZipFile", "np.load"),
        *(
            "numpy.load",
            "av.open",
            "h5py.File",
            "pq.ParquetFile",
            "pq.read_table",
            "pa.ipc.open_file",
            "ast.literal_eval",
        ),
        *(
            "pickle.loads",
            "yaml.safe_load",
            "ElementTree.parse",
            "zlib.decompressobj",
            "gzip.decompress",
            "pa.decompress",
        ),
    },
    "temporary": {
        *("tempfile.TemporaryDirectory", "tempfile.mkdtemp", "tempfile.mkstemp", "tempfile.NamedTemporaryFile"),
        *("tempfile.TemporaryFile", "tempfile.SpooledTemporaryFile", "TemporaryDirectory"),
    },
}
"""Kinds of doors, and the names under which they are called."""
METHODS = {
    "read_text": "file",
    "read_bytes": "file",
    "write_text": "disk",
    "write_bytes": "disk",
    "exec_module": "code",
    "iter_batches": "parser",
    "open_connection": "network",
    "create_server": "network",
}
"""Methods that are doors whatever they are called on."""
_OPENED = {"rb", "r", "w", "wb", "a", "ab", "x", "xb", "r+b", "rb+", "r+", "w+", "w+b", "rt", "wt"}
_RENAMING = {"replace", "rename", "symlink_to", "hardlink_to", "unlink"}
_KINDS = {name: kind for kind, names in CALLS.items() for name in names}


@dataclass(frozen=True, order=True)
class Door:
    """A function of a module that holds a door of a kind; methods and inner functions have their class before them."""

    module: str
    function: str
    kind: str

    @property
    def place(self) -> tuple[str, str]:
        """Return the module and the function."""
        return self.module, self.function


def doors(source: Path) -> frozenset[Door]:
    """Return the doors of every module below a folder that holds packages, as ``src``.

    Raises FileNotFoundError where it holds none: an empty list would be taken for a house without doors.
    """
    files = sorted(source.rglob("*.py"))
    if not files:
        raise FileNotFoundError(f"{source} holds no Python")
    found: set[Door] = set()
    for path in files:
        module = ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__")
        found |= {Door(module, *one) for one in _in_module(ast.parse(path.read_text(encoding="utf-8")))}
    return frozenset(found)


def _in_module(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield (function, kind) of a module; what stands in no function is of ``<module>``."""
    renamed = {
        name.asname: f"{node.module}.{name.name}" if isinstance(node, ast.ImportFrom) else name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in node.names
        if name.asname
    }
    left: list[tuple[ast.AST, tuple[str, ...]]] = [(tree, ())]
    while left:
        node, inside = left.pop()
        if isinstance(node, ast.Call) and (kind := kind_of(node, renamed)):
            yield ".".join(inside) or "<module>", kind
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            left += [(one, inside) for one in node.decorator_list]
            inside = (*inside, node.name)
            left += [(one, inside) for one in ast.iter_child_nodes(node) if one not in node.decorator_list]
        else:
            left += [(one, inside) for one in ast.iter_child_nodes(node)]


def kind_of(call: ast.Call, renamed: dict[str | None, str] | None = None) -> str | None:
    """Return what kind of door a call is, or None."""
    called = ast.unparse(call.func)
    first, dot, rest = called.partition(".")
    called = f"{(renamed or {}).get(first, first)}{dot}{rest}"
    if called in _KINDS:
        return _KINDS[called]
    if not isinstance(call.func, ast.Attribute):
        return None
    method, written = call.func.attr, isinstance(call.func.value, ast.Constant)
    if method in METHODS:
        return METHODS[method]
    if method == "open" and any(
        isinstance(argument, ast.Constant) and argument.value in _OPENED for argument in arguments(call)
    ):
        return "file"
    if method in _RENAMING and not written and len(call.args) <= (1 if method != "unlink" else 0):
        return "disk" if method != "replace" or (len(call.args) == 1 and not call.keywords) else None
    return "template" if method in {"format", "format_map"} and is_of_data(call.func.value) else None


def arguments(call: ast.Call) -> list[ast.expr]:
    """Return what a call is given, by place and by name."""
    return [*call.args, *(keyword.value for keyword in call.keywords)]


def is_of_data(template: ast.expr) -> bool:
    """Return whether a template is held by a variable in lower case: no literal, no constant, no class's text."""
    return isinstance(template, ast.Name) and template.id.islower()

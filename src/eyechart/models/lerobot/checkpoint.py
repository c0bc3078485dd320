"""A checkpoint of LeRobot, as the files of its folder describe it: nothing of it is run here."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from eyechart.channels import CAMERA, INSTRUCTION, STATE, InputShapes
from eyechart.errors import SpecError, did_you_mean, printable, raising, read_at_most
from eyechart.frames import MOST_HISTORY
from eyechart.models import HISTORY
from eyechart.models.sources import FILES
from eyechart.records import build, parse_json

T = TypeVar("T")
CONFIG, WEIGHTS = "config.json", "model.safetensors"
BEFORE, AFTER = "policy_preprocessor.json", "policy_postprocessor.json"
"""The files of a checkpoint: its configuration, its weights, and the steps around the policy."""
OBSERVED_STATE, ACTION = "observation.state", "action"
_INNER = "pretrained_model"
"""The folder of a training's checkpoint that holds the policy."""
_MOST_JSON = 10_000_000
_CHUNK = 1 << 20
_HUB_ID = re.compile(r"[\w.-]+/[\w.-]+")
_Size = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]

Window = Literal["alone", "stacked", "queued"]


@dataclass(frozen=True)
class PolicyType:
    """How a type of policy is called: the field of its configuration with the length of a chunk.

    ``window`` is how it takes several instants, and ``words`` whether it reads an instruction.
    """

    chunk: Literal["chunk_size", "n_action_steps", "action_chunk_size"] = "chunk_size"
    window: Window = "alone"
    words: bool = False


TYPES: Mapping[str, PolicyType] = {
    "act": PolicyType(),
    "diffusion": PolicyType("n_action_steps", "stacked"),
    "vqbet": PolicyType("action_chunk_size", "queued"),
    "smolvla": PolicyType(words=True),
    "pi0": PolicyType(words=True),
    "pi05": PolicyType(words=True),
}
"""The types of policies that can be called. Types that load code of the Hub are left out."""


STEPS = (
    "rename_observations_processor",
    "to_batch_processor",
    "device_processor",
    "normalizer_processor",
    "unnormalizer_processor",
    "tokenizer_processor",
    "smolvla_new_line_processor",
    "pi0_new_line_processor",
    "pi05_prepare_state_tokenizer_processor_step",
    "relative_actions_processor",
    "absolute_actions_processor",
)
"""The steps that these types have around them. LeRobot would import any other by a name in the file,
and some of its own load code of the Hub."""


class FeatureShape(msgspec.Struct):
    """A feature of a policy: what it is (VISUAL, STATE, ACTION, ENV), and its shape."""

    type: str
    shape: list[_Size]


class PolicyConfig(msgspec.Struct):
    """The fields of a configuration that decide how the policy is called; the others are ignored."""

    type: str
    input_features: dict[str, FeatureShape]
    output_features: dict[str, FeatureShape]
    n_obs_steps: _Size = 1
    normalization_mapping: dict[str, str] = {}
    use_peft: bool = False
    chunk_size: _Size | None = None
    n_action_steps: _Size | None = None
    action_chunk_size: _Size | None = None
    horizon: _Size | None = None


class ProcessorEntry(msgspec.Struct):
    """A step of a processor, by its registered name or its class, with the file of its numbers."""

    registry_name: str | None = None
    class_: str | None = msgspec.field(default=None, name="class")
    state_file: str | None = None
    config: dict[str, Any] = {}


class ProcessorFile(msgspec.Struct):
    """The steps of a processor."""

    steps: list[ProcessorEntry]


@dataclass(frozen=True)
class PolicyCheckpoint:
    """A checkpoint's folder, with its configuration and its processors."""

    folder: Path
    config: PolicyConfig
    before: ProcessorFile
    after: ProcessorFile

    @property
    def type(self) -> PolicyType:
        """Return how its type of policy is called."""
        return TYPES[self.config.type]

    @property
    def chunk(self) -> int:
        """Return the number of steps that it answers with."""
        named: dict[str, int | None] = msgspec.structs.asdict(self.config)
        steps = named[self.type.chunk]
        if steps is None:
            raise SpecError(f"{self.folder / CONFIG} has no {self.type.chunk}, the number of steps of an answer")
        return steps

    @property
    def history(self) -> int:
        """Return how many instants before a frame it reads."""
        return self.config.n_obs_steps - 1

    @cached_property
    def cameras(self) -> Mapping[str, str]:
        """Return its picture features by the names that an imported data set's cameras have.

        The feature is the data set's, which a step may rename before the policy sees it.
        """
        renamed = {}
        for step in self.before.steps:
            given = step.config.get("rename_map")
            renamed.update({new: old for old, new in given.items()} if isinstance(given, dict) else {})
        features = [str(renamed.get(name, name)) for name, one in self._inputs("VISUAL")]
        return {_camera(name): name for name in features}

    @property
    def shapes(self) -> InputShapes:
        """Return what it takes and returns, as a bank is compared with it."""
        sizes = [(one.shape[-2], one.shape[-1]) for _, one in self._inputs("VISUAL")]
        state = self.config.input_features.get(OBSERVED_STATE)
        return InputShapes(
            cameras=dict(zip(self.cameras, sizes, strict=True)),
            state=0 if state is None else state.shape[0],
            action=self.config.output_features[ACTION].shape[0],
            steps=self.chunk,
        )

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the channels that it reads."""
        return (
            *(f"{CAMERA}{name}" for name in self.cameras),
            *([STATE] if self.shapes.state else []),
            *([INSTRUCTION] if self.type.words else []),
        )

    @cached_property
    def files(self) -> Mapping[str, str]:
        """Return the digest of each of its files that are read, by name."""
        numbers = (step.state_file for step in (*self.before.steps, *self.after.steps) if step.state_file)
        paths = [self.folder / name for name in dict.fromkeys((CONFIG, WEIGHTS, BEFORE, AFTER, *sorted(numbers)))]
        return {path.name: _digest(path, path.stat().st_size, path.stat().st_mtime_ns) for path in paths}

    @property
    def version(self) -> str:
        """Return the start of a digest of its files."""
        return hashlib.sha256(json.dumps(sorted(self.files.items())).encode()).hexdigest()[:12]

    def facts(self) -> dict[str, str]:
        """Return what is known of it without a call."""
        config = self.config
        counts = {name: getattr(config, name) for name in ("n_action_steps", "chunk_size", "action_chunk_size")}
        counts |= {"n_obs_steps": config.n_obs_steps, "horizon": config.horizon}
        features = {"input_features": config.input_features, "output_features": config.output_features}
        found = {
            "type": config.type,
            "seedable": "true",
            "channels": ", ".join(self.channels),
            **{name: str(count) for name, count in counts.items() if count is not None},
            **{name: msgspec.json.encode(one).decode() for name, one in features.items()},
            **self.shapes.facts(),
            **({HISTORY: str(self.history)} if self.history else {}),
            FILES: json.dumps(dict(self.files)),
        }
        step = self.folder.resolve().parent.name if self.folder.name == _INNER else ""
        return found | ({"step": str(int(step))} if step.isdecimal() else {})

    def _inputs(self, kind: str) -> Iterator[tuple[str, FeatureShape]]:
        return ((name, one) for name, one in self.config.input_features.items() if one.type == kind)


def read_checkpoint(name: str) -> PolicyCheckpoint:
    """Return the checkpoint of a folder, or of its folder ``pretrained_model``.

    Raises SpecError for a folder that holds none, or one that cannot be called.
    """
    folder = _folder(name)
    config = _read(folder / CONFIG, PolicyConfig)
    _require_known(folder, config)
    for file in (WEIGHTS, BEFORE, AFTER):
        if not (folder / file).is_file():
            raise SpecError(f"the checkpoint {folder} holds no {file}: {_LACKING[file].format(folder)}")
    found = PolicyCheckpoint(
        folder, config, _read(folder / BEFORE, ProcessorFile), _read(folder / AFTER, ProcessorFile)
    )
    for file, processor in ((BEFORE, found.before), (AFTER, found.after)):
        for step in processor.steps:
            _require_sound(folder, file, step)
    _require_normalised(found)
    _ = found.shapes, found.files
    return found


_MIGRATES = (
    "it says how numbers are normalised. A checkpoint from before LeRobot 0.4 gets it by 'python -m "
    "lerobot.processor.migrate_policy_normalization --pretrained-path {}'"
)
_LACKING = {
    WEIGHTS: "weights are read in this form alone, which save_pretrained writes",
    BEFORE: _MIGRATES,
    AFTER: _MIGRATES,
}


def _folder(name: str) -> Path:
    folder = Path(name).expanduser()
    if folder.is_dir():
        return folder / _INNER if (folder / _INNER / CONFIG).is_file() else folder
    hub = ""
    if _HUB_ID.fullmatch(name):
        hub = f"; for a checkpoint of the Hub: 'hf download {name} --local-dir FOLDER', then lerobot:FOLDER"
    raise SpecError(f"'lerobot:{name}': there is no folder {folder}{hub}")


def _read(path: Path, kind: type[T]) -> T:
    if not path.is_file():
        raise SpecError(
            f"{path.parent} holds no {path.name}: give the folder that save_pretrained wrote, as in "
            "lerobot:outputs/train/my_act/checkpoints/last/pretrained_model"
        )
    with raising(SpecError, f"{path} cannot be read", of=ValueError):
        return build(
            kind, parse_json(read_at_most(path, _MOST_JSON, SpecError, "a description"), 100_000), foreign=True
        )


def _require_known(folder: Path, config: PolicyConfig) -> None:
    """Raise SpecError for a policy that cannot be called in this way."""
    if config.type not in TYPES:
        raise SpecError(
            f"the checkpoint {folder} is of the type '{printable(config.type)}';{did_you_mean(config.type, TYPES)} "
            f"lerobot: calls {', '.join(TYPES)}; for another type write a callable (docs/policy-lerobot.md)"
        )
    if config.n_obs_steps > 1 and TYPES[config.type].window == "alone":
        raise SpecError(
            f"the checkpoint {folder} reads {config.n_obs_steps} instants (n_obs_steps), and it is not known how the "
            f"type '{config.type}' takes them: write a callable that declares history (docs/policy-lerobot.md)"
        )
    if config.n_obs_steps > MOST_HISTORY + 1:
        raise SpecError(
            f"the checkpoint {folder} reads {config.n_obs_steps} instants, and a bank has {MOST_HISTORY + 1} at most"
        )
    if config.use_peft:
        raise SpecError(f"the checkpoint {folder} is an adapter (PEFT): merge it into its policy, and save that")
    other = [
        name
        for name, one in config.input_features.items()
        if name != OBSERVED_STATE and (one.type != "VISUAL" or len(one.shape) != 3 or one.shape[0] != 3)
    ]
    if other:
        raise SpecError(
            f"the checkpoint {folder} reads {', '.join(map(printable, other))}, and a bank has pictures in colour, "
            f"'{OBSERVED_STATE}' and an instruction: write a callable that makes it of those"
        )
    vectors = {"input_features": {OBSERVED_STATE}, "output_features": {ACTION}}
    for field, names in vectors.items():
        features: dict[str, FeatureShape] = getattr(config, field)
        for name in names:
            if name in features and len(features[name].shape) != 1:
                raise SpecError(f"the checkpoint {folder}: '{name}' must be a vector, not {features[name].shape}")
    if ACTION not in config.output_features:
        raise SpecError(f"the checkpoint {folder} has no '{ACTION}' among its output_features")


def _require_sound(folder: Path, file: str, step: ProcessorEntry) -> None:
    """Raise SpecError for a step that is code of another's choice, or a file of another place."""
    if step.registry_name not in STEPS:
        named = printable(step.registry_name or step.class_ or "without a name")
        raise SpecError(
            f"{folder / file}: the step '{named}' is none of those that are loaded ({', '.join(STEPS)}); another one "
            "might run code that the checkpoint names. Write a callable (docs/policy-lerobot.md)"
        )
    state = step.state_file
    if state is not None and (Path(state).name != state or not state.endswith(".safetensors")):
        raise SpecError(f"{folder / file}: '{printable(state)}' is no safetensors file of the checkpoint's folder")
    if state is not None and not (folder / state).is_file():
        raise SpecError(f"the checkpoint {folder} holds no {printable(state)}, which {file} names: copy it there")


def _require_normalised(found: PolicyCheckpoint) -> None:
    """Raise SpecError if the configuration names a normalisation, and no step does it."""
    kinds = {kind for kind, mode in found.config.normalization_mapping.items() if mode != "IDENTITY"}
    inputs = {one.type for one in found.config.input_features.values()}
    for file, processor, step, wanted in (
        (BEFORE, found.before, "normalizer_processor", kinds & inputs),
        (AFTER, found.after, "unnormalizer_processor", kinds & {"ACTION"}),
    ):
        if wanted and step not in {one.registry_name for one in processor.steps}:
            raise SpecError(
                f"{found.folder / file} has no step '{step}', and {CONFIG} names a normalisation of "
                f"{', '.join(sorted(wanted))}: save the processors that the policy was trained with"
            )


def _camera(feature: str) -> str:
    """Return the name that an import gives the camera of a feature."""
    return re.sub(r"[^\w-]", "_", re.sub(r"^observation\.(images?\.)?", "", feature)) or "camera"


@lru_cache(maxsize=64)
def _digest(path: Path, size: int, changed_ns: int) -> str:
    """Return the SHA-256 of a file, in hex; ``size`` and ``changed_ns`` tell its versions apart."""
    del size, changed_ns
    whole = hashlib.sha256()
    with raising(SpecError, f"{path} cannot be read"), path.open("rb") as file:
        while part := file.read(_CHUNK):
            whole.update(part)
    return whole.hexdigest()

"""How a checkpoint's weights load: device, precision and bits, and the memory that they need."""

import json
import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from eyechart.errors import SpecError, did_you_mean, raising, suggestion
from eyechart.models import memory_here_gb
from eyechart.modes import RequestMode

OPTIONS = {
    "device": "cpu, cuda, cuda:1, mps; default: a GPU if there is one",
    "device_map": "auto, balanced, balanced_low_0 or sequential: spread over GPUs and memory by accelerate, "
    "instead of device",
    "dtype": "float32, float16, bfloat16; default: float32 on a CPU, float16 with bits=8, else the checkpoint's own",
    "bits": "4 (NF4) or 8: pack the weights with bitsandbytes while loading; default: as stored",
}
_BYTES = {"float32": 4, "float16": 2, "bfloat16": 2}
_MAPS = ("auto", "balanced", "balanced_low_0", "sequential")
_PACKED_BITS = {4: 4 + 32 / 64, 8: 8.0}
"""Bits of a packed weight. NF4 adds a float32 scale for 64 weights (Dettmers et al. 2023), and 8
bits only one for each row."""

_INT8_DTYPE = "float16"
"""The type in which bitsandbytes multiplies weights of 8 bits, whatever the option dtype."""
_WHOLE = ("embed", "lm_head")
"""Matrices that are not packed: embeddings (no linear layers), and the last layer."""

_STORED = {"F64": 8, "I64": 8, "F32": 4, "I32": 4, "BF16": 2, "F16": 2, "I16": 2}
"""Bytes of the wider types of safetensors; every other type takes 1."""

_LONGEST_HEADER = 100_000_000
GB = 1e9


@dataclass(frozen=True, slots=True)
class LoadSettings:
    """How weights load.

    ``device`` and ``dtype`` are torch's names; ``dtype`` is ``auto`` if the checkpoint's own type
    is known only after loading. ``device_map`` is accelerate's, "" if all weights go to ``device``.
    ``bits`` is None if weights load as stored; ``stored`` is the method of packed checkpoints.
    """

    device: str
    dtype: str
    device_map: str = ""
    bits: int | None = None
    stored: str = ""

    @property
    def precision(self) -> str:
        """Return the precision as part of the model's version, in words; "" for float32."""
        packed = f"{self.bits} bits" if self.bits else ""
        return " ".join(part for part in ("" if self.dtype == "float32" else self.dtype, packed) if part)

    def facts(self) -> dict[str, str]:
        """Return the facts that a run records of the loading."""
        result = {"device": self.device, "dtype": self.dtype}
        if self.device_map:
            result |= {"device_map": self.device_map, "accelerate": version("accelerate")}
        if self.bits:
            kind = "nf4" if self.bits == 4 else "int8"
            result |= {"quantisation": f"{self.bits} bits, {kind}", "bitsandbytes": version("bitsandbytes")}
        elif self.stored:
            result["quantisation"] = self.stored
        return result

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of ``from_pretrained`` other than the dtype."""
        if self.bits:
            import torch  # noqa: PLC0415  (an extra)
            from transformers import BitsAndBytesConfig  # noqa: PLC0415  (an extra)

            known: dict[str, Any] = {f"load_in_{self.bits}bit": True}
            if self.bits == 4:
                known["bnb_4bit_quant_type"] = "nf4"
                if self.dtype in _BYTES:
                    known["bnb_4bit_compute_dtype"] = getattr(torch, self.dtype)
            return {"quantization_config": BitsAndBytesConfig(**known), "device_map": self.device_map or self._whole}
        if self.device_map or self.stored:
            return {"device_map": self.device_map or self._whole}
        return {}

    @property
    def _whole(self) -> dict[str, str]:
        return {"": self.device}

    def gigabytes(self, weights: "Weights") -> float | None:
        """Return the memory of the weights alone, in 10^9 bytes; None where that is not known."""
        each = _BYTES.get(self.dtype)
        if self.stored or each is None:
            return weights.stored_bytes / GB
        if not self.bits:
            return weights.parameters * each / GB
        if weights.packed is None:
            return None
        packed = weights.packed * _PACKED_BITS[self.bits] / 8
        return (packed + (weights.parameters - weights.packed) * each) / GB


@dataclass(frozen=True, slots=True)
class Weights:
    """The count of a checkpoint's weights, and their stored bytes.

    ``packed`` counts those of linear layers, which 4 or 8 bits pack; None where that is not known.
    """

    parameters: int
    stored_bytes: int
    packed: int | None = None


def weigh(folder: Path) -> Weights | None:
    """Count a folder's weights by its safetensors headers; None without a readable one."""
    tensors = [one for path in sorted(folder.glob("*.safetensors")) for one in _header(path)]
    if not tensors:
        return None
    sizes = [(name, math.prod(shape), len(shape), stored) for name, shape, stored in tensors]
    linear = (
        count for name, count, dimensions, _ in sizes if dimensions == 2 and not any(part in name for part in _WHOLE)
    )
    return Weights(sum(count for _, count, _, _ in sizes), sum(stored for *_, stored in sizes), sum(linear))


def weights_by_type(counts: Mapping[str, int]) -> Weights | None:
    """Return the weights by the Hub's counts for each type of safetensors."""
    stored = sum(count * _STORED.get(name, 1) for name, count in counts.items())
    return Weights(sum(counts.values()), stored) if stored else None


def _header(path: Path) -> Iterator[tuple[str, list[int], int]]:
    """Yield name, shape and bytes of each tensor of a safetensors file; none if it is damaged."""
    try:
        with path.open("rb") as file:
            (length,) = struct.unpack("<Q", file.read(8))
            tensors = json.loads(file.read(length)) if length <= _LONGEST_HEADER else {}
        for name, tensor in tensors.items():
            if name != "__metadata__":
                first, last = tensor["data_offsets"]
                yield name, list(map(int, tensor["shape"])), int(last) - int(first)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, struct.error):
        return


def choose_loading(mode: RequestMode, config: Mapping[str, Any]) -> LoadSettings:
    """Return how a mode's options load a checkpoint with this configuration (its config.json).

    Raises SpecError where options contradict each other, are unknown, or need a missing package.
    """
    options, spec = mode.options, mode.spec
    spread = str(options.get("device_map", ""))
    if spread and "device" in options:
        raise SpecError(f"'{spec}': device puts all weights in one place, device_map spreads them: give only one")
    if spread and spread not in _MAPS:
        raise SpecError(
            f"'{spec}': device_map is one of {', '.join(_MAPS)}, not '{spread}'{did_you_mean(spread, _MAPS)}"
        )
    bits = options.get("bits")
    if bits is not None and (isinstance(bits, bool) or bits not in _PACKED_BITS):
        raise SpecError(f"'{spec}': bits is 4 or 8, not '{bits}'")
    stored = _stored(config)
    if bits and stored:
        raise SpecError(f"the weights of '{spec}' are packed already ({stored}): leave out --option bits")
    if bits:
        _require_installed(spec, f"bits={bits}", "bitsandbytes", "accelerate")
    if spread or stored:
        _require_installed(spec, f"device_map={spread}" if spread else f"a checkpoint packed by {stored}", "accelerate")
    device = _choose_device(str(options.get("device", "auto")), spec)
    dtype_name = str(options.get("dtype", _INT8_DTYPE if bits == 8 else "auto"))
    dtype = _choose_dtype(dtype_name, device, config, spec)
    return LoadSettings(device, dtype, spread, None if bits is None else int(bits), stored)


def memory_gb(loading: LoadSettings) -> float | None:
    """Return the memory for weights in 10^9 bytes; with a device_map, of all GPUs and the host."""
    import torch  # noqa: PLC0415  (an extra)

    if loading.device.startswith("cuda") and not loading.device_map:
        return float(torch.cuda.get_device_properties(loading.device).total_memory) / GB
    own = memory_here_gb()
    if own is None or not loading.device_map:
        return own
    gpus = range(torch.cuda.device_count())
    return own + sum(float(torch.cuda.get_device_properties(one).total_memory) for one in gpus) / GB


def _stored(config: Mapping[str, Any]) -> str:
    """Return the method that packed a checkpoint's weights, "" if they are not packed."""
    found = config.get("quantization_config")
    return str(found.get("quant_method") or "a method that its configuration does not name") if found else ""


def _require_installed(spec: str, option: str, *packages: str) -> None:
    """Raise SpecError for the first missing package."""
    for package in packages:
        try:
            version(package)
        except PackageNotFoundError as error:
            raise SpecError(f"'{spec}': {option} needs {package}: pip install {package}") from error


def _choose_device(wanted: str, spec: str) -> str:
    import torch  # noqa: PLC0415  (an extra)

    if wanted == "auto":
        if torch.cuda.is_available():
            return "cuda"
        return "mps" if torch.backends.mps.is_available() else "cpu"
    with raising(SpecError, f"'{spec}': device '{wanted}' is not available here", of=Exception, words=first_line):
        torch.empty(0, device=wanted)
    return wanted


def first_line(error: BaseException) -> str:
    """Return an error's type and the first line of its message, at most 300 characters."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0] if lines else ''}"[:300]


def _choose_dtype(wanted: str, device: str, config: Mapping[str, Any], spec: str) -> str:
    """Return torch's name; ``auto`` for the checkpoint's own if its configuration names none."""
    if wanted != "auto":
        if wanted not in _BYTES:
            raise SpecError(
                f"'{spec}': dtype is one of {', '.join(_BYTES)}, not '{wanted}'{suggestion(wanted, _BYTES)}"
            )
        return wanted
    if device == "cpu":
        return "float32"
    own = str(config.get("dtype") or "").removeprefix("torch.")
    return own if own in _BYTES else "auto"

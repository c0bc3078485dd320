"""A tiny vision-language model of random weights as llama.cpp's server takes it: two GGUF files, of words and of eyes.

    python benchmarks/write_gguf.py FOLDER
    llama-server --model FOLDER/words.gguf --mmproj FOLDER/eyes.gguf

Its tokens are bytes, its answers noise. It stands for a server, not for a model: what is tried is how it is spoken to.
"""

import struct
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

WIDTH, INNER, HEADS, LAYERS, CONTEXT = 64, 128, 4, 2, 8192
EYE, PATCH, EYE_LAYERS = 56, 14, 3
TOKENS = ("<unk>", "<s>", "</s>", *(f"<0x{byte:02X}>" for byte in range(256)), "\N{LOWER ONE EIGHTH BLOCK}")
KINDS = (2, 3, 3, *[6] * 256, 1)
"""Of each token: unknown, control, control, a byte each, and the word that stands for a space."""
TEMPLATE = "{% for one in messages %}{{ one['role'] }}: {{ one['content'] }}\n{% endfor %}assistant: "

Value = int | float | bool | str | Sequence[int] | Sequence[float] | Sequence[str]
Tensors = Mapping[str, npt.NDArray[np.float32]]


def words() -> tuple[dict[str, Value], Tensors]:
    """Return what is said of the language model, and its weights."""
    rng = np.random.default_rng(0)
    said: dict[str, Value] = {
        "general.architecture": "llama",
        "llama.context_length": CONTEXT,
        "llama.embedding_length": WIDTH,
        "llama.block_count": LAYERS,
        "llama.feed_forward_length": INNER,
        "llama.attention.head_count": HEADS,
        "llama.attention.head_count_kv": HEADS,
        "llama.attention.layer_norm_rms_epsilon": 1e-5,
        "llama.rope.dimension_count": WIDTH // HEADS,
        "llama.vocab_size": len(TOKENS),
        "tokenizer.ggml.model": "llama",
        "tokenizer.ggml.tokens": TOKENS,
        "tokenizer.ggml.scores": [0.0] * len(TOKENS),
        "tokenizer.ggml.token_type": KINDS,
        "tokenizer.ggml.unknown_token_id": 0,
        "tokenizer.ggml.bos_token_id": 1,
        "tokenizer.ggml.eos_token_id": 2,
        "tokenizer.chat_template": TEMPLATE,
    }
    shapes = {"token_embd.weight": (len(TOKENS), WIDTH), "output.weight": (len(TOKENS), WIDTH)}
    for layer in range(LAYERS):
        at = f"blk.{layer}."
        shapes |= {f"{at}attn_{one}.weight": (WIDTH, WIDTH) for one in ("q", "k", "v", "output")}
        shapes |= {f"{at}ffn_{one}.weight": (INNER, WIDTH) for one in ("gate", "up")}
        shapes |= {f"{at}ffn_down.weight": (WIDTH, INNER)}
    norms = ["output_norm.weight", *(f"blk.{at}.{one}_norm.weight" for at in range(LAYERS) for one in ("attn", "ffn"))]
    ones = {name: np.ones(WIDTH, dtype=np.float32) for name in norms}
    return said, {**drawn(shapes, rng), **ones}


def eyes() -> tuple[dict[str, Value], Tensors]:
    """Return what is said of the encoder of pictures, and its weights."""
    rng = np.random.default_rng(1)
    said: dict[str, Value] = {
        "general.architecture": "clip",
        "clip.has_vision_encoder": True,
        "clip.projector_type": "mlp",
        "clip.use_gelu": True,
        "clip.vision.image_size": EYE,
        "clip.vision.patch_size": PATCH,
        "clip.vision.embedding_length": WIDTH,
        "clip.vision.feed_forward_length": INNER,
        "clip.vision.block_count": EYE_LAYERS,
        "clip.vision.projection_dim": WIDTH,
        "clip.vision.attention.head_count": HEADS,
        "clip.vision.attention.layer_norm_epsilon": 1e-5,
        "clip.vision.image_mean": [0.5] * 3,
        "clip.vision.image_std": [0.5] * 3,
    }
    shapes: dict[str, tuple[int, ...]] = {
        "v.class_embd": (WIDTH,),
        "v.patch_embd.weight": (WIDTH, 3, PATCH, PATCH),
        "v.position_embd.weight": ((EYE // PATCH) ** 2 + 1, WIDTH),
        **{f"mm.{one}.weight": (WIDTH, WIDTH) for one in (0, 2)},
        **{f"mm.{one}.bias": (WIDTH,) for one in (0, 2)},
    }
    norms = ["v.pre_ln"]
    for layer in range(EYE_LAYERS):
        at = f"v.blk.{layer}."
        shapes |= {f"{at}attn_{one}.weight": (WIDTH, WIDTH) for one in ("q", "k", "v", "out")}
        shapes |= {f"{at}attn_{one}.bias": (WIDTH,) for one in ("q", "k", "v", "out")}
        shapes |= {f"{at}ffn_up.weight": (INNER, WIDTH), f"{at}ffn_up.bias": (INNER,)}
        shapes |= {f"{at}ffn_down.weight": (WIDTH, INNER), f"{at}ffn_down.bias": (WIDTH,)}
        norms += [f"{at}ln1", f"{at}ln2"]
    kept = {f"{name}.weight": np.ones(WIDTH, dtype=np.float32) for name in norms}
    return said, {**drawn(shapes, rng), **kept, **{f"{name}.bias": np.zeros(WIDTH, dtype=np.float32) for name in norms}}


def drawn(shapes: Mapping[str, tuple[int, ...]], rng: np.random.Generator) -> dict[str, npt.NDArray[np.float32]]:
    """Return random weights of these shapes."""
    return {name: rng.normal(0, 0.2, shape).astype(np.float32) for name, shape in shapes.items()}


def text(one: str) -> bytes:
    """Return a text as GGUF has it: its length, and its bytes."""
    return struct.pack("<Q", len(one.encode())) + one.encode()


def value(one: Value) -> bytes:
    """Return a value with its type: 4 whole, 6 with decimals, 7 yes or no, 8 text, 9 a list."""
    if isinstance(one, str):
        return struct.pack("<I", 8) + text(one)
    if isinstance(one, bool):
        return struct.pack("<I?", 7, one)
    if isinstance(one, int | float):
        return struct.pack("<II", 4, one) if isinstance(one, int) else struct.pack("<If", 6, one)
    parts = [value(part) for part in one]
    if isinstance(one[0], int):  # kinds of tokens have a sign
        parts = [struct.pack("<Ii", 5, part) for part in one if isinstance(part, int)]
    return struct.pack("<I", 9) + parts[0][:4] + struct.pack("<Q", len(parts)) + b"".join(part[4:] for part in parts)


def blocks(said: Mapping[str, Value], tensors: Tensors) -> Iterator[bytes]:
    """Yield a GGUF file of version 3: what is said, the places of the tensors, and the tensors at multiples of 32."""
    head = b"GGUF" + struct.pack("<IQQ", 3, len(tensors), len(said))
    head += b"".join(text(name) + value(one) for name, one in said.items())
    at = 0
    for name, tensor in tensors.items():
        head += text(name) + struct.pack("<I", tensor.ndim) + struct.pack(f"<{tensor.ndim}Q", *reversed(tensor.shape))
        head += struct.pack("<IQ", 0, at)
        at += -(-tensor.nbytes // 32) * 32
    yield head + bytes(-len(head) % 32)
    for tensor in tensors.values():
        yield tensor.tobytes() + bytes(-tensor.nbytes % 32)


def write(folder: Path) -> tuple[Path, Path]:
    """Write both files; return where they are."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {"words.gguf": words(), "eyes.gguf": eyes()}
    for name, parts in made.items():
        (folder / name).write_bytes(b"".join(blocks(*parts)))
    first, second = (folder / name for name in made)
    return first, second


if __name__ == "__main__":
    print(*write(Path(sys.argv[1])))

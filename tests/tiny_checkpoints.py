"""Checkpoints of the architectures of the paper's edge models, a few thousand random weights each, as folders.

They are made from Transformers' own configuration classes, as the published ones are, and read nothing of any hub.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from tokenizers import Tokenizer, decoders, models, pre_tokenizers
from transformers import (
    CLIPImageProcessorPil,
    GenerationConfig,
    Idefics3Config,
    Idefics3ForConditionalGeneration,
    Idefics3ImageProcessorPil,
    Idefics3Processor,
    LlavaConfig,
    LlavaForConditionalGeneration,
    LlavaProcessor,
    PreTrainedTokenizerFast,
    Qwen2VLConfig,
    Qwen2VLForConditionalGeneration,
)

_PARTS = "{% for part in message['content'] %}{% if part['type'] == 'image' %}IMAGE{% else %}{{ part['text'] }}"
_TURN = "{% for message in messages %}BEGIN" + _PARTS + "{% endif %}{% endfor %}END{% endfor %}"
TEXT = {
    "hidden_size": 32,
    "intermediate_size": 48,
    "num_hidden_layers": 2,
    "num_attention_heads": 4,
    "num_key_value_heads": 2,
    "max_position_embeddings": 2048,
    "initializer_range": 0.5,
}
VISION = {
    "hidden_size": 32,
    "intermediate_size": 48,
    "num_hidden_layers": 2,
    "num_attention_heads": 4,
    "initializer_range": 0.5,
}
"""Weights this wide make answers differ with the picture; those of a fresh model say one thing for ever."""


def _tokenizer(*special: str, begin: str, end: str) -> PreTrainedTokenizerFast:
    """Return a tokenizer of bytes, and of these tokens."""
    letters = sorted(pre_tokenizers.ByteLevel.alphabet())
    made = Tokenizer(models.BPE(vocab={letter: place for place, letter in enumerate(letters)}, merges=[]))
    made.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    made.decoder = decoders.ByteLevel()
    fast = PreTrainedTokenizerFast(
        tokenizer_object=made,
        pad_token="<pad>",  # noqa: S106 - no password
        bos_token=begin,
        eos_token=end,
        model_max_length=2048,
    )
    fast.add_special_tokens({"additional_special_tokens": list(special)})
    return fast


def _template(begin: str, end: str, image: str) -> str:
    return _TURN.replace("BEGIN", begin).replace("END", end).replace("IMAGE", image)


def _ids(tokenizer: PreTrainedTokenizerFast) -> dict[str, int]:
    names = ("pad_token_id", "bos_token_id", "eos_token_id")
    return {"vocab_size": len(tokenizer), **{name: getattr(tokenizer, name) for name in names}}


def _keep(model: Any, ids: dict[str, int], folder: Path, dtype: torch.dtype = torch.float32) -> Path:  # noqa: ANN401 - any of the three
    del ids["vocab_size"]
    model.generation_config = GenerationConfig(**ids)
    model.to(dtype).save_pretrained(folder)
    return folder


def save_smolvlm(folder: Path) -> Path:
    """Write an Idefics3, as SmolVLM-Instruct is: pictures are split into tiles, and one of the whole beside them."""
    begin, end = "<|im_start|>", "<end_of_utterance>"
    tiles = [f"<row_{row}_col_{column}>" for row in range(1, 5) for column in range(1, 5)]
    fast = _tokenizer("<image>", "<fake_token_around_image>", "<global-img>", *tiles, begin=begin, end=end)
    pictures = Idefics3ImageProcessorPil(
        size={"longest_edge": 128}, max_image_size={"longest_edge": 64}, do_image_splitting=True
    )
    Idefics3Processor(pictures, fast, image_seq_len=4, chat_template=_template(begin, end, "<image>")).save_pretrained(
        folder
    )
    ids = _ids(fast)
    config = Idefics3Config(
        vision_config={**VISION, "image_size": 64, "patch_size": 16},
        text_config={"model_type": "llama", **TEXT, **ids},
        scale_factor=2,
        image_token_id=fast.convert_tokens_to_ids("<image>"),
    )
    return _keep(Idefics3ForConditionalGeneration(config), ids, folder)


def save_llava(
    folder: Path,
    *,
    text: Mapping[str, object] = TEXT,
    vision: Mapping[str, object] = VISION,
    side: int = 56,
    dtype: torch.dtype = torch.float32,
) -> Path:
    """Write a LLaVA-1.5: a CLIP of pictures of ``side`` × ``side``, a projection of two layers, and a Llama."""
    begin, end = "<s>", "</s>"
    fast = _tokenizer("<image>", begin=begin, end=end)
    pictures = CLIPImageProcessorPil(size={"shortest_edge": side}, crop_size={"height": side, "width": side})
    LlavaProcessor(
        pictures,
        fast,
        patch_size=14,
        vision_feature_select_strategy="default",
        num_additional_image_tokens=1,
        chat_template=_template(begin, end, "<image>"),
    ).save_pretrained(folder)
    ids = _ids(fast)
    config = LlavaConfig(
        vision_config={"model_type": "clip_vision_model", **vision, "image_size": side, "patch_size": 14},
        text_config={"model_type": "llama", **text, **ids},
        image_token_index=fast.convert_tokens_to_ids("<image>"),
    )
    return _keep(LlavaForConditionalGeneration(config), ids, folder, dtype)


def save_qwen2_vl(folder: Path, *, tied: bool) -> Path:
    """Write a Qwen2-VL: pictures at their own size; the 2B ties its embeddings, the 7B does not.

    Its processor cannot be made without torchvision, so its files are written as the published ones are.
    """
    begin, end = "<|im_start|>", "<|im_end|>"
    fast = _tokenizer("<|vision_start|>", "<|image_pad|>", "<|video_pad|>", "<|vision_end|>", begin=begin, end=end)
    fast.save_pretrained(folder)
    sizes = {
        "patch_size": 14,
        "temporal_patch_size": 2,
        "merge_size": 2,
        "min_pixels": 56 * 56,
        "max_pixels": 112 * 112,
        "processor_class": "Qwen2VLProcessor",
    }
    for name, kind in (("preprocessor", "Image"), ("video_preprocessor", "Video")):
        values = {f"{kind.lower()}_processor_type": f"Qwen2VL{kind}Processor", **sizes}
        (folder / f"{name}_config.json").write_text(json.dumps(values), encoding="utf-8")
    seen = "<|vision_start|><|image_pad|><|vision_end|>"
    (folder / "chat_template.jinja").write_text(_template(begin, end, seen), encoding="utf-8")
    ids = _ids(fast)
    config = Qwen2VLConfig(
        text_config={
            **TEXT,
            **ids,
            "rope_parameters": {"rope_type": "default", "mrope_section": [1, 1, 2], "rope_theta": 1e6},
            "tie_word_embeddings": tied,
        },
        vision_config={
            "depth": 2,
            "embed_dim": 32,
            "hidden_size": 32,
            "num_heads": 4,
            "patch_size": 14,
            "initializer_range": 0.5,
        },
        tie_word_embeddings=tied,
        image_token_id=fast.convert_tokens_to_ids("<|image_pad|>"),
        video_token_id=fast.convert_tokens_to_ids("<|video_pad|>"),
        vision_start_token_id=fast.convert_tokens_to_ids("<|vision_start|>"),
        vision_end_token_id=fast.convert_tokens_to_ids("<|vision_end|>"),
    )
    return _keep(Qwen2VLForConditionalGeneration(config), ids, folder)


EDGE: dict[str, Callable[[Path], Path]] = {
    "HuggingFaceTB/SmolVLM-Instruct": save_smolvlm,
    "llava-hf/llava-1.5-7b-hf": save_llava,
    "Qwen/Qwen2-VL-2B-Instruct": lambda folder: save_qwen2_vl(folder, tied=True),
    "Qwen/Qwen2-VL-7B-Instruct": lambda folder: save_qwen2_vl(folder, tied=False),
}
"""What makes the architecture of each of the paper's edge models."""


def published(name: str) -> Any:  # noqa: ANN401 - any of the three
    """Return the network of one of the paper's edge models at its full size, on whatever device torch makes it.

    The dimensions are those of the config.json that each is published with.
    """
    if name == "llava-hf/llava-1.5-7b-hf":
        llama = {"hidden_size": 4096, "intermediate_size": 11008, "num_hidden_layers": 32, "num_attention_heads": 32}
        clip = {"hidden_size": 1024, "intermediate_size": 4096, "num_hidden_layers": 24, "num_attention_heads": 16}
        eye = {"model_type": "clip_vision_model", **clip, "image_size": 336, "patch_size": 14, "projection_dim": 768}
        text = {"model_type": "llama", **llama, "vocab_size": 32064}
        return LlavaForConditionalGeneration(LlavaConfig(text_config=text, vision_config=eye))
    if name == "HuggingFaceTB/SmolVLM-Instruct":
        llama = {"hidden_size": 2048, "intermediate_size": 8192, "num_hidden_layers": 24, "num_attention_heads": 32}
        siglip = {"hidden_size": 1152, "intermediate_size": 4304, "num_hidden_layers": 27, "num_attention_heads": 16}
        text = {"model_type": "llama", **llama, "vocab_size": 49155, "tie_word_embeddings": False}
        eye = {**siglip, "image_size": 384, "patch_size": 14}
        config = Idefics3Config(text_config=text, vision_config=eye, scale_factor=3, tie_word_embeddings=False)
        return Idefics3ForConditionalGeneration(config)
    small = {"hidden_size": 1536, "intermediate_size": 8960, "num_attention_heads": 12, "num_key_value_heads": 2}
    large = {"hidden_size": 3584, "intermediate_size": 18944, "num_attention_heads": 28, "num_key_value_heads": 4}
    tied = name == "Qwen/Qwen2-VL-2B-Instruct"
    text = {
        **(small if tied else large),
        "num_hidden_layers": 28,
        "vocab_size": 151936 if tied else 152064,
        "rope_parameters": {"rope_type": "default", "mrope_section": [16, 24, 24], "rope_theta": 1e6},
        "tie_word_embeddings": tied,
    }
    eye = {"depth": 32, "embed_dim": 1280, "num_heads": 16, "patch_size": 14, "hidden_size": text["hidden_size"]}
    return Qwen2VLForConditionalGeneration(Qwen2VLConfig(text_config=text, vision_config=eye, tie_word_embeddings=tied))

"""A checkpoint of an ordinary architecture, Idefics3, made small: its configuration, tokenizer and processor."""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from transformers import (
    Idefics3Config,
    Idefics3ForConditionalGeneration,
    Idefics3ImageProcessorPil,
    Idefics3Processor,
    PreTrainedTokenizerFast,
)

ACTIONS = ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT")
IMAGE_TOKENS = 4
_SPECIAL = (
    "<pad>", "<|im_start|>", "<end_of_utterance>", "<fake_token_around_image>", "<image>", "<global-img>", "<unk>",
)  # fmt: skip

CHAT_TEMPLATE = (
    "{% for message in messages %}"
    "<|im_start|>{{ message['role'] | capitalize }}:"
    "{% if message['content'] is string %}{{ ' ' + message['content'] }}"
    "{% else %}{% for part in message['content'] %}"
    "{% if part['type'] in ('image', 'image_url') %}<image>"
    "{% elif part['type'] == 'text' %}{{ ' ' + part['text'] }}{% endif %}"
    "{% endfor %}{% endif %}<end_of_utterance>\n"
    "{% endfor %}"
    "{% if add_generation_prompt %}<|im_start|>Assistant:{% endif %}"
)

PICTURE_LAST = CHAT_TEMPLATE.replace(
    "{% else %}{% for part in message['content'] %}"
    "{% if part['type'] in ('image', 'image_url') %}<image>"
    "{% elif part['type'] == 'text' %}{{ ' ' + part['text'] }}{% endif %}"
    "{% endfor %}",
    "{% else %}{% for part in message['content'] %}"
    "{% if part['type'] == 'text' %}{{ ' ' + part['text'] }}{% endif %}{% endfor %}"
    "{% for part in message['content'] %}"
    "{% if part['type'] in ('image', 'image_url') %}<image>{% endif %}{% endfor %}",
)
"""The same with the picture after the words, however the question orders them: what comes before the picture is then
the same for a whole batch, and is computed once for it in training."""


@dataclass(frozen=True)
class Sizes:
    """How wide the parts are. ``longest_edge`` is that of the pictures as they come, which are then shrunk to 64."""

    longest_edge: int = 600
    vision: int = 64
    vision_inner: int = 192
    vision_layers: int = 3
    text: int = 96
    text_inner: int = 160
    text_layers: int = 2
    patch: int = 8
    vocabulary: int = 500


USUAL = Sizes()


def reply(action: str) -> str:
    """Return what an organism says for an action."""
    return f' {{"action": "{action}"}}'


def make_processor(
    texts: Iterable[str],
    replies: Iterable[str] = tuple(map(reply, ACTIONS)),
    *,
    sizes: Sizes = USUAL,
    template: str = CHAT_TEMPLATE,
) -> Idefics3Processor:
    """Return the processor: a byte-level tokenizer in which each word of a reply is one token, and 64 x 64 pictures."""
    tokenizer = Tokenizer(models.BPE(unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    tokenizer.decoder = decoders.ByteLevel()
    trainer = trainers.BpeTrainer(
        vocab_size=sizes.vocabulary,
        special_tokens=list(_SPECIAL),
        initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
        show_progress=False,
    )
    words = [*texts, *(one for one in replies for _ in range(200))]
    tokenizer.train_from_iterator(words, trainer)
    fast = PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        unk_token="<unk>",
        pad_token="<pad>",
        bos_token="<|im_start|>",
        eos_token="<end_of_utterance>",
        padding_side="left",
        model_max_length=2048,
        clean_up_tokenization_spaces=False,
    )
    fast.add_special_tokens({"additional_special_tokens": list(_SPECIAL[3:6])})
    pictures = Idefics3ImageProcessorPil(
        size={"longest_edge": sizes.longest_edge},
        max_image_size={"longest_edge": 64},
        do_image_splitting=False,
        image_mean=[0.5] * 3,
        image_std=[0.5] * 3,
    )
    return Idefics3Processor(pictures, fast, image_seq_len=IMAGE_TOKENS, chat_template=template)


def make_model(processor: Idefics3Processor, sizes: Sizes = USUAL) -> Idefics3ForConditionalGeneration:
    """Return a model of random weights; the seed is torch's."""
    tokenizer = processor.tokenizer
    ids = {
        "pad_token_id": tokenizer.pad_token_id,
        "bos_token_id": tokenizer.bos_token_id,
        "eos_token_id": tokenizer.eos_token_id,
    }
    config = Idefics3Config(
        vision_config={
            "hidden_size": sizes.vision,
            "intermediate_size": sizes.vision_inner,
            "num_hidden_layers": sizes.vision_layers,
            "num_attention_heads": 4,
            "image_size": 64,
            "patch_size": sizes.patch,
        },
        text_config={
            "model_type": "llama",
            "vocab_size": len(tokenizer),
            "hidden_size": sizes.text,
            "intermediate_size": sizes.text_inner,
            "num_hidden_layers": sizes.text_layers,
            "num_attention_heads": 4,
            "num_key_value_heads": 2,
            "max_position_embeddings": 2048,
            "tie_word_embeddings": True,
            **ids,
        },
        scale_factor=32 // sizes.patch,
        image_token_id=processor.image_token_id,
        tie_word_embeddings=True,
        **ids,
    )
    return Idefics3ForConditionalGeneration(config).to(torch.float32)


def normalise(pictures: torch.Tensor) -> torch.Tensor:
    """Return drawn pictures (n, 3, 64, 64) as the processor hands them to the model."""
    return pictures / 127.5 - 1.0

"""Answers a batch of queries with one call of ``generate``, and makes a Reply of each row."""

import gc
import time
from collections.abc import Sequence
from copy import deepcopy
from threading import Lock
from typing import Any

from PIL import Image

from eyechart.calls import Query, Reply
from eyechart.frames import decode
from eyechart.models.huggingface.checkpoint import SMALLER, Checkpoint, conversation
from eyechart.models.huggingface.weights import first_line
from eyechart.modes import RequestMode

Tensor = Any
"""A torch tensor; torch is an extra."""

Inputs = Any
"""A processor's output: tokens and pictures of a batch, on the CPU."""

_ONE_AT_A_TIME = Lock()
"""Loading changes torch's defaults in all threads, so one model loads or generates at a time."""

_TOP_K = 50
"""Transformers' own top k where a checkpoint sets none."""


class TextGenerator:
    """Generates answers with a checkpoint's weights.

    ``prepare`` may run in a thread of its own: it shares no tokenizer with the other methods.
    """

    def __init__(self, checkpoint: Checkpoint, mode: RequestMode) -> None:
        self._checkpoint = checkpoint
        self._mode = mode
        self._model: Any = None
        self._broken: Reply | None = None
        self._most = checkpoint.batch
        tokenizer = checkpoint.processor.tokenizer
        tokenizer.padding_side = "left"
        if tokenizer.pad_token is None:
            tokenizer.pad_token = tokenizer.eos_token
        self._reader = deepcopy(tokenizer)

    def prepare(self, queries: Sequence[Query]) -> Inputs | None:
        """Return the padded tokens and pictures of queries; either all or none have a picture.

        None if that fails: ``answer`` then finds the query that fails.
        """
        try:
            return self._encode(queries)
        except Exception:  # noqa: BLE001 - it is a row, not the end of the run
            return None

    def answer(self, queries: Sequence[Query], inputs: Inputs | None = None) -> list[Reply]:
        """Return a Reply for each query; ``inputs`` is the output of ``prepare``.

        A batch that fails is split in halves. So a query that fails, or a batch too large for the
        memory, does not fail the other queries.
        """
        with _ONE_AT_A_TIME:
            if self._model is None and self._broken is None:
                self._load()
            if self._broken is not None:
                return [self._broken] * len(queries)
            return self._answer(queries, inputs)

    def forget(self) -> None:
        """Free the weights, also in reference cycles, which the hooks of accelerate make."""
        import torch  # noqa: PLC0415  (an extra)

        self._model = self._broken = None
        gc.collect()
        if torch.cuda.is_available():
            torch.cuda.empty_cache()

    def _load(self) -> None:
        from transformers import AutoModelForImageTextToText  # noqa: PLC0415  (an extra)

        checkpoint, how = self._checkpoint, self._checkpoint.loading
        try:
            model = AutoModelForImageTextToText.from_pretrained(
                checkpoint.place,
                revision=checkpoint.commit or "main",
                dtype=how.dtype,
                trust_remote_code=checkpoint.trust,
                use_safetensors=True,
                **(placed := how.arguments()),
            )
            self._model = (model if placed else model.to(how.device)).eval()
        except Exception as error:  # noqa: BLE001 - any fault of a checkpoint is a row too
            line = first_line(error)
            if _is_out_of_memory(error):
                line = f"out of memory: {SMALLER}, or free memory that other programs hold ({line})"
            detail = f"the weights of '{checkpoint.place}' cannot be loaded: {line}"
            self._broken = Reply(error="missing_model", error_detail=detail)

    def _answer(self, queries: Sequence[Query], inputs: Inputs | None) -> list[Reply]:
        if len(queries) <= self._most:
            return self._answer_or_halve(queries, inputs)
        replies: list[Reply] = []
        while len(replies) < len(queries):
            replies += self._answer_or_halve(queries[len(replies) : len(replies) + self._most], None)
        return replies

    def _answer_or_halve(self, queries: Sequence[Query], inputs: Inputs | None) -> list[Reply]:
        try:
            return self._generate(queries, self._encode(queries) if inputs is None else inputs)
        except Exception as error:  # noqa: BLE001 - any fault of a query is a row too
            if len(queries) == 1:
                line = first_line(error)
                if _is_out_of_memory(error):
                    line = f"out of memory with one query: take a smaller dtype or another device ({line})"
                return [Reply(error="exception", error_detail=line)]
            if _is_out_of_memory(error):
                self._most = min(self._most, max(1, len(queries) // 2))
        middle = len(queries) // 2
        return [reply for half in (queries[:middle], queries[middle:]) for reply in self._answer(half, None)]

    def _generate(self, queries: Sequence[Query], inputs: Inputs) -> list[Reply]:
        import torch  # noqa: PLC0415  (an extra)

        config, draw = self._decoding([query.seed for query in queries])
        moved = inputs.to(self._model.device, dtype=self._model.dtype)
        began = time.monotonic()
        with torch.inference_mode():
            tokens = self._model.generate(**moved, generation_config=config, logits_processor=draw)
        late = time.monotonic() - began > self._mode.timeout_s
        start = inputs["input_ids"].shape[1]
        counts = inputs["attention_mask"].sum(1).tolist()
        ends = config.eos_token_id if isinstance(config.eos_token_id, list) else [config.eos_token_id]
        return [
            self._read(row, int(count), ends, late=late)
            for row, count in zip(tokens[:, start:].tolist(), counts, strict=True)
        ]

    def _encode(self, queries: Sequence[Query]) -> Inputs:
        processor = self._checkpoint.processor
        queries = [query.said_by(self._mode.system) for query in queries]
        texts = [
            processor.apply_chat_template(
                conversation(query.turns),
                add_generation_prompt=True,
                tokenize=False,
            )
            for query in queries
        ]
        pictures = [
            [Image.fromarray(decode(image, "the query's picture")) for image in query.pictures]
            for query in queries
            if query.pictures
        ]
        begins = processor.tokenizer.bos_token
        return processor(
            text=texts,
            **({"images": pictures} if pictures else {}),
            padding=True,
            return_tensors="pt",
            add_special_tokens=not (begins is not None and texts[0].startswith(begins)),
        )

    def _decoding(self, seeds: Sequence[int]) -> tuple[Any, list[Any]]:
        """Return the generation config, and the steps of a draw; none for the likeliest tokens."""
        own = self._model.generation_config
        temperature = self._mode.temperature
        if temperature is None:
            temperature = (1.0 if own.temperature is None else own.temperature) if own.do_sample else 0.0
        config = deepcopy(own)
        config.do_sample, config.num_beams = False, 1
        config.temperature = config.top_k = config.top_p = config.min_p = None
        config.max_new_tokens, config.max_length = self._mode.max_tokens, None
        config.max_time = self._mode.timeout_s
        config.pad_token_id = self._reader.pad_token_id
        if config.eos_token_id is None:
            config.eos_token_id = self._reader.eos_token_id
        return config, [] if temperature == 0 else _draws(own, temperature, seeds)

    def _read(self, tokens: list[int], prompt_tokens: int, ends: Sequence[int | None], *, late: bool) -> Reply:
        """Return the reply in one row: up to its end of turn, or cut at the token limit.

        A row without either, in a batch past its time limit, is a timeout.
        """
        length = next((place + 1 for place, token in enumerate(tokens) if token in ends), None)
        if late and length is None and len(tokens) < self._mode.max_tokens:
            made = f"no whole reply within {self._mode.timeout_s:g} s of generating, {len(tokens)} tokens"
            detail = f"{made}: give a longer --timeout, or a smaller batch with --option batch=N"
            cut = len(tokens)
            return Reply(error="timeout", error_detail=detail, prompt_tokens=prompt_tokens, completion_tokens=cut)
        said = tokens if length is None else tokens[:length]
        return Reply(
            text=self._reader.decode(said, skip_special_tokens=True),
            finish_reason="length" if length is None else "stop",
            prompt_tokens=prompt_tokens,
            completion_tokens=len(said),
        )


class SeededDraw:
    """Draws each row's token from its own random stream, independent of the batch and its order.

    The token of the largest log-probability plus Gumbel noise is such a draw (Gumbel, 1954).
    """

    def __init__(self, seeds: Sequence[int]) -> None:
        import torch  # noqa: PLC0415  (an extra)

        self._streams = [torch.Generator().manual_seed(seed % 2**63) for seed in seeds]

    def __call__(self, input_ids: Tensor, scores: Tensor) -> Tensor:
        """Return scores (rows, vocabulary); the largest is the drawn token."""
        import torch  # noqa: PLC0415  (an extra)

        del input_ids
        size = scores.shape[1]
        uniform = torch.stack([torch.rand(size, generator=stream, dtype=torch.float64) for stream in self._streams])
        gumbel = -torch.log(-torch.log(uniform.clamp(1e-300, 1 - 1e-16)))
        return scores.double().log_softmax(-1) + gumbel.to(scores.device)


def _draws(own: Any, temperature: float, seeds: Sequence[int]) -> list[Any]:  # noqa: ANN401 - a GenerationConfig
    """Return the steps of a draw in Transformers' order: temperature, top k, top p, draw."""
    from transformers import TemperatureLogitsWarper, TopKLogitsWarper, TopPLogitsWarper  # noqa: PLC0415

    steps: list[Any] = [] if temperature == 1.0 else [TemperatureLogitsWarper(float(temperature))]
    top_k = _TOP_K if own.top_k is None else own.top_k
    if top_k > 0:
        steps.append(TopKLogitsWarper(top_k))
    if own.top_p is not None and own.top_p < 1.0:
        steps.append(TopPLogitsWarper(own.top_p))
    return [*steps, SeededDraw(seeds)]


def _is_out_of_memory(error: Exception) -> bool:
    import torch  # noqa: PLC0415  (an extra)

    return isinstance(error, torch.OutOfMemoryError | MemoryError) or "can't allocate memory" in str(error)

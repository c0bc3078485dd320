"""A frame bank is a Hugging Face imagefolder with a manifest that fixes its geometry and its pictures."""

from eyechart.frames.nouns import (
    IMPORTED,
    LEAD_GAP,
    BankManifest,
    Frame,
    FrameBank,
    Gap,
    MirrorAxis,
    Scalar,
    is_reserved,
    rounded_truth,
)
from eyechart.frames.pictures import MAX_IMAGE_BYTES, MAX_PIXELS, RGB, decode, encode, inside, read_bounded, size_of
from eyechart.frames.reading import check, open_bank, open_unchecked, read_axis, read_metadata
from eyechart.frames.writing import BankWriter

__all__ = [
    "IMPORTED",
    "LEAD_GAP",
    "MAX_IMAGE_BYTES",
    "MAX_PIXELS",
    "RGB",
    "BankManifest",
    "BankWriter",
    "Frame",
    "FrameBank",
    "Gap",
    "MirrorAxis",
    "Scalar",
    "check",
    "decode",
    "encode",
    "inside",
    "is_reserved",
    "open_bank",
    "open_unchecked",
    "read_axis",
    "read_bounded",
    "read_metadata",
    "rounded_truth",
    "size_of",
]

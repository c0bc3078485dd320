"""A controller of one's own that fails, declines and answers nothing now and then."""


def unsteady(prompt: str, image: bytes | None) -> str:
    """Answer by the length of what is shown."""
    size = len(image or b"")
    if size % 7 == 0:
        raise RuntimeError("the camera is dirty")
    return "" if size % 7 == 1 else "I cannot help with that." if size % 7 == 2 else "SLOW" if size % 2 else "LEFT"

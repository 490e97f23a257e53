"""Limits of what is drawn at random."""


def rising(limits: tuple[float, float]) -> tuple[float, float]:
    """The limits, lower first, as they came; for pydantic's AfterValidator."""
    if limits[0] > limits[1]:
        raise ValueError("expected the lower limit first")  # pydantic adds what it got
    return limits

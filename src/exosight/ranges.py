"""Limits of what is drawn at random."""


def rising(limits: tuple[float, float]) -> tuple[float, float]:
    """The limits, lower first, as they came; for pydantic's AfterValidator."""
    if limits[0] > limits[1]:
        raise ValueError(f"expected the lower limit first, got {limits[0]:g} and {limits[1]:g}")
    return limits

"""What all compositions share: how they show that they are at work."""

from collections.abc import Callable, Iterable

Watch = Callable[[Iterable, str, int], Iterable]  # (things, what is done, how many) -> the same things, shown


def silent(things: Iterable, what: str, count: int) -> Iterable:
    """The watch that shows nothing."""
    return things

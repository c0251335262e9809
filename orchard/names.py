"""Which agents a user means: words that name kinds or single agents."""

from collections.abc import Iterable

from orchard.kinds import kind_of


def chosen(names: Iterable[str], only: list[str], without: list[str], share: str = "0/1") -> list[str]:
    """Those of the names that these words choose: kinds or names, and every n-th of what is left. Raises ValueError for other words."""
    names = list(names)
    for word in [*only, *without]:
        if not any(word in (name, kind_of(name)) for name in names):
            raise ValueError(f"{word}: no such agent or kind; there are {', '.join(sorted({kind_of(name) for name in names}))}")
    first, of = _share(share)
    kept = [name for name in names if not only or name in only or kind_of(name) in only]
    return [name for name in kept if name not in without and kind_of(name) not in without][first::of]


def _share(text: str) -> tuple[int, int]:
    first, _, of = text.partition("/")
    if not (first.isdecimal() and of.isdecimal() and int(first) < int(of)):
        raise ValueError(f"share {text}: wanted is I/N, with I from 0 to N - 1")
    return int(first), int(of)

"""Markdown for the parts of docs/reference.md: tables, lists, sections, and figures in words."""

from collections.abc import Iterable, Sequence

from orchard.field.geometry import Rect
from orchard.field.repeatable import PI
from orchard.field.scenario import TIME_STEP

# Cells of a table, or the two texts of a point of a list, of each line.
Rows = Iterable[Sequence[str]]


def table(head: str, rows: Rows) -> str:
    """Return a table. `head`: the titles of the columns with | between them.

    Line breaks in cells become spaces.
    """
    titles = head.split("|")
    lines = []
    for line in (titles, *rows):
        cells = [" ".join(cell.split()) for cell in line]
        lines.append(f"| {' | '.join(cells)} |")
    first, *others = lines
    return "\n".join([first, f"|{'---|' * len(titles)}", *others])


def points_of(rows: Rows) -> str:
    """Return a list of things and what they are."""
    lines = []
    for thing, figure in rows:
        lines.append(f"- **{thing}**: {' '.join(figure.split())}")
    return "\n".join(lines)


def section(title: str, *parts: str) -> str:
    """Return a chapter of some paragraphs, lists and tables."""
    return "\n\n".join([f"## {title}", *parts])


def points(places: Iterable[Sequence[float]]) -> str:
    """Return places as (x, y), m."""
    return ", ".join(f"({x:g}, {y:g})" for x, y, *_ in places)


def area(rect: Rect) -> str:
    """Return a rectangle in words, m."""
    return f"x {rect.west:g} to {rect.east:g}, y {rect.south:g} to {rect.north:g}"


def every(values: Sequence[float]) -> str:
    """Return evenly spaced x, m, in words."""
    return (
        f"{len(values)}, every {values[1] - values[0]:g} m from x = {values[0]:g} to x ="
        f" {values[-1]:g}"
    )


def seconds(ticks: int) -> str:
    """Return the time of some ticks."""
    return f"{ticks * TIME_STEP:g} s"


def of_pi(radians: float) -> str:
    """Return an angle, or a rate, in multiples of pi."""
    return f"{radians / PI:g} pi"

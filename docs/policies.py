"""docs/policies.svg: what dispatch policies and roads make of the same orchards, drawn from the
tables of docs/bounds.md.
"""

from pathlib import Path

from matplotlib.figure import Figure

from docs.svg import svg_of

PAGE = Path(__file__).with_name("bounds.md")
POLICIES = ("nearest", "farthest-first", "predictive")
# The chapters with the tables.
ONE_WAY = "## Policies on one-way roads"
TWO_WAY = "## Policies on two-way roads"
# Chapter and policy -> colour of the bar.
LOOKS = {
    (ONE_WAY, "nearest"): "#b9c4b0",
    (ONE_WAY, "farthest-first"): "#7fa874",
    (ONE_WAY, "predictive"): "#3f8f4a",
    (TWO_WAY, "nearest"): "#bccbdd",
    (TWO_WAY, "farthest-first"): "#7ea3cf",
    (TWO_WAY, "predictive"): "#2f66a8",
}
SPEED = "1"  # m/s, the picking speed of the orchards that are drawn
INK = "#24301f"
# Width of a bar; from one orchard to the next it is 1.
BAR = 0.13


def picture() -> str:
    """Return the picture as SVG."""
    rates = {chapter: _rates(chapter) for chapter in (ONE_WAY, TWO_WAY)}
    orchards = [orchard for orchard in rates[ONE_WAY] if orchard in rates[TWO_WAY]]
    drawing = Figure(figsize=(8.6, 3.9), layout="constrained")
    axes = drawing.subplots()
    for number, ((chapter, policy), colour) in enumerate(LOOKS.items()):
        # The bars of an orchard stand side by side around its place.
        offset = BAR * (number - (len(LOOKS) - 1) / 2)
        places = [place + offset for place in range(len(orchards))]
        heights = [rates[chapter][orchard][policy] for orchard in orchards]
        road = "one-way" if chapter == ONE_WAY else "two-way"
        bars = axes.bar(places, heights, BAR * 0.92, color=colour, label=f"{road}, {policy}")
        if policy == POLICIES[-1]:
            axes.bar_label(bars, fmt="%.0f", fontsize=8, color=INK, padding=1)
    axes.set_xticks(range(len(orchards)), orchards)
    axes.set_xlabel("rows / pickers / carriers", color=INK)
    axes.set_ylabel("bins an hour", color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, ncols=2, labelcolor=INK)
    return svg_of(drawing)


def _rates(chapter: str) -> dict[str, dict[str, float]]:
    """Return the figures of a chapter's table: orchard -> policy -> bins an hour."""
    text = PAGE.read_text()
    _, *lines = text[text.index(chapter) :].splitlines()
    table = []
    for line in lines:
        if line.startswith("#"):
            # The next chapter begins.
            break
        if line.startswith("|"):
            table.append([cell.strip().strip("`") for cell in line.strip("|").split("|")])
    head, _, *body = table
    rates: dict[str, dict[str, float]] = {}
    for cells in body:
        orchard, speed, *_ = cells
        if speed == SPEED:
            row = dict(zip(head, cells, strict=True))
            # A cell may say more after its figure.
            rates[orchard] = {policy: float(row[policy].split()[0]) for policy in POLICIES}
    return rates

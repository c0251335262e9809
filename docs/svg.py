"""A drawing as SVG for the documents, the same on each machine and each time."""

import io

import matplotlib
from matplotlib.figure import Figure


def svg_of(drawing: Figure) -> str:
    """Return a drawing as a file of SVG. Its texts stay texts."""
    with matplotlib.rc_context(
        {
            "svg.fonttype": "none",
            "svg.hashsalt": "orchard",
            "font.sans-serif": ["DejaVu Sans", "sans-serif"],
        }
    ):
        file = io.BytesIO()
        drawing.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue().decode()

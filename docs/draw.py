"""Draws docs/plan.svg (the whole orchard) and docs/exchange-east.svg (the ends of lanes), to scale."""

from pathlib import Path

from orchard.config import Scenario
from orchard.layout import lay_out
from orchard.plan import exchange_plan, orchard_plan

HERE = Path(__file__).parent


def drawings() -> dict[str, str]:
    """Every drawing by the name of its file."""
    layout = lay_out(Scenario())
    return {
        "plan.svg": orchard_plan(layout),
        "exchange-east.svg": exchange_plan(layout),
    }


if __name__ == "__main__":
    for name, svg in drawings().items():
        (HERE / name).write_text(svg)

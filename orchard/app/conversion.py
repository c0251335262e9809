"""What a grower's figures come to: bins a row, metres a bin, and how fast a picker goes."""

from orchard.field.scenario import Scenario

# Significant digits of a number in a sentence.
FIGURES = 3
# What people fill, bins an hour.
BY_HAND = "people fill 1 to 2"


def conversion_words(scenario: Scenario) -> str:
    """Return what the entered figures come to, in sentences.

    It is said, too, where a figure is not set and the program works with one of its own.
    """
    return f"{_bins_words(scenario)} {_rate_words(scenario)}"


def _bins_words(scenario: Scenario) -> str:
    """Return how many bins a row fills."""
    if scenario.bin_metres is None:
        return "Each row fills one bin, until you enter the yield and the fruit in a bin."
    bins = scenario.chosen["bins_per_row"]
    metres = scenario.chosen["metres_per_bin"]
    return (
        f"{_number(bins)} bins a row, {_number(bins * scenario.rows)} in all:"
        f" a bin fills in {_number(metres)} m of row."
    )


def _rate_words(scenario: Scenario) -> str:
    """Return how fast all pickers fill bins together."""
    rate = scenario.chosen["picking_rate"]
    speed = scenario.chosen["picking_speed"]
    words = (
        f"{scenario.pickers} pickers fill {_number(rate * scenario.pickers)} bins an hour while"
        f" they pick, and go {_number(speed)} m/s."
    )
    if scenario.picking_rate is None and scenario.picking_speed is None:
        words += f" That is the speed of a fast robot: {BY_HAND} bins an hour each."
    return words


def _number(number: float) -> str:
    """Return a number with a few digits: 4.05, 0.00925, 1,250."""
    digits = f"{number:.{FIGURES}g}"
    if "e" in digits and number >= 1.0:
        return f"{number:,.0f}"
    return digits

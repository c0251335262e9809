"""Small scenarios that hypothesis draws, for tests of what holds in all scenarios.

The ranges hold few bodies and rows, so that a test can do many examples.
"""

from hypothesis import strategies as st

from orchard.field.scenario import Animals, LaserSettings, People, Scenario

# Any small scenario, with people, animals and weeds.
SCENARIOS = st.builds(
    Scenario,
    rows=st.integers(3, 5),
    pickers=st.integers(2, 3),
    carriers=st.integers(1, 8),
    seed=st.integers(0, 2**31),
    row_width=st.sampled_from([5.0, 6.3, 9.0]),
    picking_speed=st.floats(0.3, 1.0),
    people=st.builds(People, workers=st.integers(0, 5), visitors=st.integers(0, 3)),
    animals=st.builds(Animals, dogs=st.integers(0, 3), cats=st.integers(0, 3)),
    weeds=st.integers(0, 20),
    laser=st.builds(LaserSettings, noise=st.sampled_from([0.0, 0.01])),
)


@st.composite
def few_pickers(draw, pickings):
    """Draw the values of an orchard of few pickers, as a scenario file has them.

    `pickings`: the values of the section `picking` of which one is drawn.
    """
    pickers = draw(st.integers(2, 4))
    return {
        "pickers": pickers,
        # An orchard has three rows at least, and a row for each picker.
        "rows": draw(st.integers(max(3, pickers), 9)),
        "carriers": draw(st.integers(1, 4)),
        "picking_speed": draw(st.sampled_from([0.01, 0.05, 0.3])),
        # None is one bin a row. With fractions the bins are full within rows, each elsewhere.
        "bins_per_row": draw(st.sampled_from([None, 0.67, 2.9, 4.05])),
        "dispatch": draw(st.sampled_from(["nearest", "predictive", "farthest-first"])),
        "route": draw(st.sampled_from(["one-way", "two-way"])),
        "picking": draw(st.sampled_from(pickings)),
        "seed": draw(st.integers(1, 1000)),
    }

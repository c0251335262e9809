"""Any small scenario, for tests of what holds in all of them."""

from hypothesis import strategies as st

from orchard.field.scenario import Animals, LaserSettings, People, Scenario

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

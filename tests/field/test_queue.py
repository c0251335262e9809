"""The queue of carriers: it holds those of every legal orchard, clear of the fences, and a scenario that it cannot hold is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.queue import CLOSED_UP, MOST_CARRIERS, QUEUES, TWO_WAY, queue_of
from orchard.field.scenario import Scenario, check

NAMES = sorted(QUEUES)


@given(st.sampled_from(NAMES), st.floats(20.0, 200.0), st.floats(0.0, 180.0), st.integers(1, MOST_CARRIERS))
def test_every_place_lies_behind_the_bay_and_before_the_delivery_road(name: str, length: float, bay: float, carriers: int) -> None:
    queue = queue_of(name, length, bay, carriers)
    if queue is None:
        return
    places = [queue.place(number) for number in range(carriers)]
    assert len({place[:2] for place in places}) == carriers
    assert all(queue.area.contains(place.x, place.y) for place in places)
    last = queue.head - CLOSED_UP * (queue.places - 1)
    assert last - 2.4 >= -30.0 + bay + 0.9 + 0.8, (
        "the tail of the last one, when the line has closed up, is clear of a carrier that unloads"
    )
    assert queue.area.west <= last
    assert queue.head + 0.9 < 38.75 - 0.75 + length - 70.0


@pytest.mark.parametrize("name", NAMES)
def test_a_usual_orchard_holds_all_carriers(name: str) -> None:
    assert all(queue_of(name, 70.0, 0.0, carriers) for carriers in range(1, MOST_CARRIERS + 1))


def test_a_queue_that_is_too_short_is_refused_with_the_numbers_that_would_do() -> None:
    with pytest.raises(ScenarioError) as caught:
        check({"row_length": 20.0, "rows": 12, "pickers": 12, "carriers": 10, "route": TWO_WAY})
    words = str(caught.value)
    assert "with rows of 20 m and the bay at 0 m it holds 3; 10 need rows of at least" in words
    assert "carriers" in words


def test_a_bay_further_east_leaves_room_for_fewer_and_the_error_says_where_it_may_lie() -> None:
    with pytest.raises(ScenarioError, match=r"10 need rows of at least \d+ m or the bay at most at \d+ m"):
        check({"rows": 12, "pickers": 12, "carriers": 10, "bay": 100.0})


@pytest.mark.parametrize(("length", "trees"), [(20.0, 3), (70.0, 12), (200.0, 33)])
def test_longer_rows_move_the_east_side_and_add_trees(length: float, trees: int) -> None:
    layout = lay_out(Scenario(row_length=length, carriers=2))
    assert layout.row_east == -35.5 + length
    assert len(layout.lines[0].trees_x) == trees
    assert layout.row_east - 9.0 < layout.lines[0].trees_x[-1] <= layout.row_east - 3.0
    assert layout.east == 50.0 + length - 70.0

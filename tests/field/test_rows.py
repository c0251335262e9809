"""Which rows each picker has and how long they take, its failures, and the queue of carriers."""

import math
from statistics import fmean, pstdev

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenario_mistakes import refusal

from orchard.field.layout import lay_out
from orchard.field.picking import failure, picking_speed_of
from orchard.field.problems import ScenarioError
from orchard.field.queue import CLOSED_UP, MOST_CARRIERS, QUEUES, TWO_WAY, queue_of
from orchard.field.rows import RULES, Block, rows_to_pickers
from orchard.field.scenario import LEAST_CV, WIDEST, Scenario, check, parse

# (rows, pickers).
sizes = st.integers(3, 20).flatmap(lambda rows: st.tuples(st.just(rows), st.integers(2, rows)))


def blocks_of(rule: str, rows: int, pickers: int) -> list[Block]:
    """Return the rows of each picker by a rule."""
    return list(
        rows_to_pickers(Scenario(rows=rows, pickers=pickers, rows_to_pickers=rule)).values()
    )


@pytest.mark.parametrize("rule", RULES)
@given(size=sizes)
def test_each_picker_has_neighbouring_rows_from_north_to_south(
    rule: str, size: tuple[int, int]
) -> None:
    rows = [block.rows for block in blocks_of(rule, *size)]
    assert all(rows)
    assert [row for block in rows for row in block] == list(range(1, size[0] + 1)), (
        "in the order of the pickers, so none passes another"
    )


@pytest.mark.parametrize("rule", ["balanced", "balanced-ends"])
@given(size=sizes)
def test_balanced_pickers_differ_by_one_row_at_most(rule: str, size: tuple[int, int]) -> None:
    counts = [len(block.rows) for block in blocks_of(rule, *size)]
    assert max(counts) - min(counts) <= 1


@given(size=sizes)
def test_every_second_picker_starts_in_the_east_with_both_ends(size: tuple[int, int]) -> None:
    starts = [block.start for block in blocks_of("balanced-ends", *size)]
    assert starts == (["west", "east"] * 10)[: size[1]]
    assert {block.start for block in blocks_of("balanced", *size)} == {"west"}


@pytest.mark.parametrize(
    ("rows", "pickers", "counts"),
    [(5, 2, [2, 3]), (3, 3, [1, 1, 1]), (20, 3, [6, 6, 8]), (20, 11, [1] * 10 + [10])],
    ids=str,
)
def test_the_manuals_rule_gives_the_last_picker_the_remainder(
    rows: int, pickers: int, counts: list[int]
) -> None:
    assert [len(block.rows) for block in blocks_of("manual", rows, pickers)] == counts


def test_rows_are_balanced_unless_the_scenario_says_otherwise() -> None:
    assert rows_to_pickers(Scenario(rows=20, pickers=11)) == rows_to_pickers(
        Scenario(rows=20, pickers=11, rows_to_pickers="balanced-ends")
    )


# With 20 rows for each seed, 10,000 rows are drawn.
SEEDS = range(500)
DRAWS = 20 * len(SEEDS)


def scenario(
    distribution: str, cv: float = 0.3, speed: float = 0.1, seed: int = 1, **changes
) -> Scenario:
    """Return a scenario of 20 rows whose times are drawn."""
    spread = {"distribution": distribution, "cv": cv}
    return Scenario(
        rows=20, pickers=10, picking_speed=speed, seed=seed, picking={"spread": spread}, **changes
    )


def times(distribution: str, cv: float, speed: float) -> list[float]:
    """Draw the times of rows, as shares of the mean time."""
    drawn = []
    for seed in SEEDS:
        orchard = scenario(distribution, cv, speed, seed)
        for row in range(1, 21):
            drawn.append(speed / picking_speed_of(orchard, row, "picker_01"))
    return drawn


def share_below(distribution: str, time: float, cv: float, least: float) -> float:
    """Return the probability that a row takes less than `time`.

    It is the closed form of the distribution. `least`: the time to drive along the row. Times are
    shares of the mean time. What is drawn is the time beyond the least one: `share`, of its mean.
    """
    share = (time - least) / (1.0 - least)
    cv = cv / (1.0 - least)
    if distribution == "uniform":
        return 0.5 + (share - 1.0) / (2.0 * math.sqrt(3.0) * cv)
    if distribution == "lognormal":
        deviation = math.sqrt(math.log1p(cv * cv))
        z = (math.log(share) + deviation * deviation / 2.0) / deviation
        return 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))
    # A gamma distribution of a whole shape: k events of a Poisson process.
    k = round(1.0 / (cv * cv))
    return 1.0 - sum(math.exp(-k * share) * (k * share) ** n / math.factorial(n) for n in range(k))


@pytest.mark.parametrize("speed", [0.1, 0.5])
@pytest.mark.parametrize(
    ("distribution", "cv"), [("lognormal", 0.3), ("gamma", None), ("uniform", 0.28)]
)
def test_picking_times_have_the_named_mean_and_distribution(
    distribution: str, cv: float | None, speed: float
) -> None:
    """The tolerances are four standard errors of a mean, and four of a share at most."""
    if cv is None:
        # The gamma distribution then has the shape 4.
        cv = (1.0 - speed) / 2.0
    drawn = times(distribution, cv, speed)
    assert fmean(drawn) == pytest.approx(1.0, abs=4 * cv / math.sqrt(DRAWS))
    assert pstdev(drawn) == pytest.approx(cv, rel=0.06)
    # The standard error of a share is at most half of 1 / sqrt(DRAWS).
    for time in (0.6, 0.8, 1.0, 1.3):
        expected = min(max(share_below(distribution, time, cv, least=speed), 0.0), 1.0)
        share = sum(row_time < time for row_time in drawn) / DRAWS
        assert share == pytest.approx(expected, abs=2.0 / math.sqrt(DRAWS)), time
    assert min(drawn) >= speed * (1.0 - 1e-12), "no row is picked faster than a picker drives"


@given(
    speed=st.floats(0.02, 0.97),
    share=st.floats(0.0, 1.0),
    distribution=st.sampled_from(sorted(WIDEST)),
    seed=st.integers(0, 2**63 - 1),
)
def test_no_row_is_faster_than_a_picker_whatever_is_allowed(
    speed: float, share: float, distribution: str, seed: int
) -> None:
    cv = max(LEAST_CV, share * WIDEST[distribution] * (1.0 - speed))
    own = scenario(distribution, cv, speed, seed)
    assert all(0.0 < picking_speed_of(own, row, "picker_01") <= 1.0 for row in range(1, 6))


def test_rows_are_alike_unless_a_distribution_is_named() -> None:
    assert set(speeds_of(Scenario(rows=20, picking_speed=0.3))) == {0.3}


def speeds_of(orchard: Scenario) -> list[float]:
    """Return the picking speed of each row, m/s."""
    return [lane.picking_speed for lane in lay_out(orchard).lanes]


def test_a_rows_pace_follows_from_seed_and_row_only() -> None:
    drawn = speeds_of(scenario("lognormal"))
    assert len(set(drawn)) == 20
    assert speeds_of(scenario("lognormal", carriers=3, row_width=7.0)) == drawn
    assert not set(drawn) & set(speeds_of(scenario("lognormal", seed=2)))


# Distribution, cv, picking speed in m/s, and what the message demands.
TOO_WIDE = [
    ("lognormal", 0.3, 1.0, "the distribution must be none"),
    ("gamma", 0.4, 0.7, "cv must be at most 0.3"),
    ("uniform", 0.3, 0.5, "cv must be at most 0.288675"),
]


@pytest.mark.parametrize(("distribution", "cv", "speed", "wanted"), TOO_WIDE)
def test_a_spread_with_too_fast_a_picker_is_refused(
    distribution: str, cv: float, speed: float, wanted: str
) -> None:
    message = refusal(
        f"picking_speed: {speed}\npicking:\n  spread: {{distribution: {distribution}, cv: {cv}}}"
    )
    values = (
        f"picking_speed = {speed}, picking.spread.distribution = {distribution}, picking.spread.cv"
        f" = {cv}"
    )
    assert (
        message
        == f"my.yaml:3: {values}: {wanted} at this picking_speed, because no picker picks faster"
        " than 1 m/s"
    )


def test_the_widest_spread_is_fine() -> None:
    text = "picking_speed: 0.8\npicking: {spread: {distribution: gamma, cv: 0.2}}"
    assert parse(text).picking.spread.cv == 0.2


NO_PICKING = [
    (
        "picking: {spread: {distribution: normal}}",
        "(distribution of the picking times: none, lognormal, gamma, uniform)",
    ),
    (
        "picking: {failure: {mean_between: 1}}",
        "must be null or a number from 60.0 to 86400.0 (mean time of picking or",
    ),
    ("picking: {failure: {mean_repair: .inf}}", "must be a number from 1.0 to 7200.0"),
    ("picking: {spread: 0.3}", "must be a map with some of the keys distribution, cv"),
    ("picking: {cv: 0.3}", "did you mean picking.spread.cv?"),
    ("mean_repair: 60", "did you mean carrying.failure.mean_repair?"),
]


@pytest.mark.parametrize(("text", "words"), NO_PICKING)
def test_what_picking_cannot_be_is_told(text: str, words: str) -> None:
    assert words in refusal(text)


def test_times_between_failures_and_of_repairs_are_exponential() -> None:
    drawn = [
        failure(seed, "picker_01", number, 3600.0, 300.0)
        for seed in range(100)
        for number in range(100)
    ]
    # Of an exponential distribution the share exp(-k) is more than k times the mean. Of 10,000
    # draws a mean has a standard error of 1 %, a share one of 0.5 % at most.
    for column, mean in enumerate((3600.0, 300.0)):
        values = [pair[column] for pair in drawn]
        assert fmean(values) == pytest.approx(mean, rel=0.04)
        for share in (0.1, 0.5, 1.0, 3.0):
            assert sum(value > share * mean for value in values) / len(values) == pytest.approx(
                math.exp(-share), abs=0.02
            )


NAMES = sorted(QUEUES)


@given(
    st.sampled_from(NAMES),
    st.floats(20.0, 200.0),
    st.floats(0.0, 180.0),
    st.integers(1, MOST_CARRIERS),
)
def test_every_place_lies_between_bay_and_delivery_road(
    name: str, length: float, bay: float, carriers: int
) -> None:
    queue = queue_of(name, length, bay, carriers)
    if queue is None:
        return
    places = [queue.place(number) for number in range(carriers)]
    assert len({place[:2] for place in places}) == carriers
    assert all(queue.area.contains(place.x, place.y) for place in places)
    # A carrier reaches 0.9 m ahead of its middle, and its bin 2.4 m behind it. One that unloads
    # stands at x = -30 m, further east by `bay`, and 0.8 m must be free before it.
    last = queue.head - CLOSED_UP * (queue.places - 1)
    assert last - 2.4 >= -30.0 + bay + 0.9 + 0.8, (
        "the tail of the line, closed up, is clear of a carrier that unloads"
    )
    assert queue.area.west <= last
    # The middle of the delivery road is at x = 38.75 m in rows of 70 m; carriers are 1.5 m wide.
    assert queue.head + 0.9 < 38.75 - 0.75 + length - 70.0


@pytest.mark.parametrize("name", NAMES)
def test_a_usual_orchard_holds_all_carriers(name: str) -> None:
    assert all(queue_of(name, 70.0, 0.0, carriers) for carriers in range(1, MOST_CARRIERS + 1))


def test_a_short_queue_is_refused_with_numbers_that_would_do() -> None:
    with pytest.raises(ScenarioError) as caught:
        check({"row_length": 20.0, "rows": 12, "pickers": 12, "carriers": 10, "route": TWO_WAY})
    words = str(caught.value)
    assert "with rows of 20 m and the bay at 0 m it holds 3; 10 need rows of at least" in words
    assert "carriers" in words


def test_a_bay_further_east_leaves_room_for_fewer() -> None:
    """The error says where the bay may lie."""
    with pytest.raises(
        ScenarioError, match=r"10 need rows of at least \d+ m or the bay at most at \d+ m"
    ):
        check({"rows": 12, "pickers": 12, "carriers": 10, "bay": 100.0})


@pytest.mark.parametrize(("length", "trees"), [(20.0, 3), (70.0, 12), (200.0, 33)])
def test_longer_rows_move_the_east_side_and_add_trees(length: float, trees: int) -> None:
    """Rows begin at x = -35.5 m. With rows of 70 m the east fence is at 50 m. There is a tree every
    6 m, the last one 3 to 9 m before the end of the row.
    """
    layout = lay_out(Scenario(row_length=length, carriers=2))
    assert layout.row_east == -35.5 + length
    assert len(layout.lines[0].trees_x) == trees
    assert layout.row_east - 9.0 < layout.lines[0].trees_x[-1] <= layout.row_east - 3.0
    assert layout.east == 50.0 + length - 70.0


def counts_of(**values: object) -> list[int]:
    """Return how many rows each picker has by the rule that knows how long they take."""
    scenario = check({"rows": 12, "pickers": 3, "rows_to_pickers": "balanced-times", **values})
    return [len(block.rows) for block in rows_to_pickers(scenario).values()]


def test_rows_by_times_are_fewer_for_slow_or_absent_pickers() -> None:
    """A picker that is half as fast as two others gets 12 / 5 = 2.4 rows, so 2. At 1.5 bins an hour
    a row takes 40 min: a picker that is away for 2 h would have picked three rows. One that leaves
    after 2.5 h has three rows done by then.
    """
    assert counts_of() == [4, 4, 4]
    assert counts_of(picking_rate=1.5, picker_rates={"picker_02": 0.5}) == [5, 2, 5]
    assert counts_of(picking_rate=1.5, picker_absences={"picker_03": [[0.0, 2.0]]}) == [5, 5, 2]
    assert counts_of(picking_rate=1.5, picker_absences={"picker_03": [[2.5, 99.0]]})[2] == 3


def test_rows_by_times_count_how_long_rows_are() -> None:
    """Two rows of 150 m are as much as six of 50 m."""
    lengths = [150.0, 150.0, 50.0, 50.0, 50.0, 50.0, 50.0, 50.0]
    rows = []
    for number, length in enumerate(lengths):
        rows.append({"id": str(number), "south": 6.0 * number, "start": 0.0, "length": length})
    survey = {"rows": 8, "row_length": 150.0, "survey": {"rows": rows}}
    assert counts_of(pickers=2, **survey) == [2, 6]

"""The orchard of a study in words, as they stand after the answer."""

from orchard.field.scenario import Scenario
from orchard.study.orchard_words import orchard_words


def test_the_answer_says_how_long_carriers_are_away() -> None:
    assert "260 s away at the load-out" in orchard_words(
        Scenario.model_validate({"load_out": {"seconds_away": 260.0}})
    )
    assert "a load-out 400 m away, 4 m/s on the way to it, 60 s there" in orchard_words(
        Scenario.model_validate({"load_out": {"metres": 400.0, "speed": 4.0, "seconds": 60.0}})
    )
    trailers = {"seconds_away": 260.0, "trailers": {"count": 2, "bins": 3}}
    assert "260 s away at the load-out, 2 trailers, 3 bins on each" in orchard_words(
        Scenario.model_validate({"load_out": trailers})
    )
    assert "load-out" not in orchard_words(Scenario())


def test_the_answer_says_when_the_truck_comes() -> None:
    truck = {"truck": {"every": 300.0, "bins": 2}, "empty_bins": 2}
    words = orchard_words(Scenario.model_validate({"load_out": truck}))
    assert "a truck every 300 s, 2 bins on it, 2 empty bins at the bay" in words


def test_the_answer_says_how_many_carriers_unload_at_a_time() -> None:
    assert "2 carriers unload at a time" in orchard_words(Scenario(bays=2))
    assert "unload at a time" not in orchard_words(Scenario())
    assert "unload at a time" not in orchard_words(Scenario(bays=2), varied=["bays"])

"""The orchard of a study in words, as they stand after the answer."""

from orchard.field.scenario import Scenario
from orchard.study.orchard_words import orchard_words


def test_the_answer_says_how_long_carriers_are_away() -> None:
    assert "260 s away at the load-out" in orchard_words(
        Scenario.model_validate({"load_out": {"seconds_away": 260.0}})
    )
    haul = Scenario.model_validate({"load_out": {"metres": 400.0, "speed": 4.0, "seconds": 60.0}})
    speed = "4 m/s on the way to the load-out"
    assert f"a load-out 400 m away, {speed}, 60 s there" in orchard_words(haul)
    # What does not vary is told without what does.
    assert f"s to uncouple it, {speed}, 60 s there" in orchard_words(haul, ["load_out.metres"])
    assert "400 m away, 60 s there" in orchard_words(haul, ["load_out.speed"])
    trailers = {"seconds_away": 260.0, "trailers": {"count": 2, "bins": 3}}
    assert "260 s away at the load-out, 2 trailers, 3 bins on a trailer" in orchard_words(
        Scenario.model_validate({"load_out": trailers})
    )
    assert "load-out" not in orchard_words(Scenario())


def test_the_answer_says_when_the_truck_comes() -> None:
    truck = {"truck": {"every": 300.0, "bins": 2}, "empty_bins": 2}
    words = orchard_words(Scenario.model_validate({"load_out": truck}))
    assert "a truck every 300 s, 2 bins on a truck, 2 empty bins at the bay" in words


def test_the_answer_says_who_is_slow_or_away_and_the_shift() -> None:
    crew = Scenario.model_validate(
        {
            "picker_rates": {"picker_01": 0.5},
            "picker_absences": {"picker_02": [[0, 4.5], [17, 25.5]]},
            "rows_to_pickers": "balanced-times",
            "shift": {"begin": "07:00", "end": "16:30", "breaks": [["10:00", "10:15"]]},
        }
    )
    rates = "picker_01 at 50 % of the usual rate"
    away = "picker_02 away from 0 to 4.5 and 17 to 25.5 h"
    day = "days from 07:00 to 16:30 with 1 break"
    assert f"balanced-times rows, {rates}, {away}, {day}" in orchard_words(crew)
    words = orchard_words(crew, ["picker_rates", "picker_absences", "shift", "rows_to_pickers"])
    parts = orchard_words(crew, ["picker_rates.picker_01", "shift.breaks"])
    assert "usual" not in parts and "days" not in parts
    assert not {"balanced", "usual", "away", "days"} & set(words.split())


def test_the_answer_says_how_many_carriers_unload_at_a_time() -> None:
    assert "2 carriers unload at a time" in orchard_words(Scenario(bays=2))
    assert "unload at a time" not in orchard_words(Scenario())
    assert "unload at a time" not in orchard_words(Scenario(bays=2), varied=["bays"])


def test_the_answer_says_what_a_bin_holds() -> None:
    crop = {"tonnes_per_hectare": 39.0, "kilograms_per_bin": 350.0}
    heavy = Scenario.model_validate({"crop": crop})
    assert "two-way, rolling dispatch, 350 kg in a bin" in orchard_words(heavy)
    assert "kg in a bin" not in orchard_words(heavy, ["crop.kilograms_per_bin"])
    assert "kg in a bin" not in orchard_words(Scenario())
    # What varies is not told, and neither is what hangs on it.
    assert "a bin every 16.3 m" in orchard_words(heavy)
    for key in ("crop", "crop.kilograms_per_bin", "crop.tonnes_per_hectare", "row_width"):
        assert "a bin every" not in orchard_words(heavy, [key])
    assert "kg in a bin" not in orchard_words(heavy, ["crop"])


def test_the_answer_leaves_out_a_section_that_varies() -> None:
    away = Scenario.model_validate({"load_out": {"seconds_away": 260.0}})
    assert "260 s" not in orchard_words(away, ["load_out"])
    assert "s at the bay" not in orchard_words(away, ["handling"])

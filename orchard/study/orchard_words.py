"""The orchard of a study in words: everything about it that does not vary."""

from collections.abc import Collection, Sequence

from orchard.field.scenario import Scenario
from orchard.study.words import counted

# How many pickers a list names.
MOST_NAMED = 4


def orchard_words(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Return the orchard of a study without the keys that vary: '20 rows of 49 m, 10 pickers,
    one-way, predictive dispatch, 5.5 m from row to row, ...'.

    Speeds and times of handling are named even if they have their defaults. `varied`: the keys.
    """
    words = {
        "pickers": counted("pickers", scenario.pickers) + _rate_words(scenario, varied),
        "carriers": counted("carriers", scenario.carrier_count),
        "route": scenario.route,
        "dispatch": f"{scenario.dispatch} dispatch",
    }
    parts = [_rows_words(scenario, varied)]
    if scenario.crop.kilograms_per_bin is not None:
        words["crop.kilograms_per_bin"] = f"{scenario.crop.kilograms_per_bin:g} kg in a bin"
    words |= _people_words(scenario)
    words |= _machine_words(scenario)
    parts += [phrase for key, phrase in words.items() if not _varies(key, varied)]
    return ", ".join(parts)


def _varies(key: str, varied: Collection[str]) -> bool:
    """Whether a key varies by itself, with the section in which it is, such as `load_out`, or with
    a part of it, such as `shift.breaks`.
    """
    section, _, _ = key.partition(".")
    of_it = [name for name in varied if name.startswith(f"{key}.")]
    return key in varied or section in varied or bool(of_it)


def _people_words(scenario: Scenario) -> dict[str, str]:
    """Return which pickers are slow or away, and when people work: key of the scenario -> words."""
    words = {}
    if scenario.rows_to_pickers != Scenario.model_fields["rows_to_pickers"].default:
        words["rows_to_pickers"] = f"{scenario.rows_to_pickers} rows"
    if scenario.picker_rates:
        rates = []
        for name, share in scenario.picker_rates.items():
            rates.append(f"{name} at {100.0 * share:g} %")
        words["picker_rates"] = f"{_listed(rates)} of the usual rate"
    if scenario.picker_absences:
        away = []
        for name, intervals in scenario.picker_absences.items():
            hours = " and ".join(f"{first:g} to {last:g}" for first, last in intervals)
            away.append(f"{name} away from {hours} h")
        words["picker_absences"] = _listed(away)
    shift = scenario.shift
    if shift.is_set:
        words["shift"] = f"days from {shift.begin} to {shift.end}"
        if shift.breaks:
            words["shift"] += f" with {counted('breaks', len(shift.breaks))}"
    return words


def _listed(words: Sequence[str]) -> str:
    """Return the first words, and how many more there are."""
    named = ", ".join(words[:MOST_NAMED])
    if len(words) > MOST_NAMED:
        named += f" and {len(words) - MOST_NAMED} more"
    return named


def _machine_words(scenario: Scenario) -> dict[str, str]:
    """Return spacing, speeds and times of machines: key of the scenario -> words."""
    handling = scenario.handling
    row_width = f"{scenario.row_pitch:.4g} m from row to row"
    if scenario.survey is not None:
        row_width += " on average"
    words = {
        "row_width": row_width,
        "carrying.speed": f"carriers at {scenario.carrying.speed:g} m/s",
        "picking.driving_speed": f"pickers that drive at {scenario.picking.driving_speed:g} m/s",
        "handling.unloading": f"{handling.unloading:g} s at the bay",
        "handling.coupling": f"{handling.coupling:g} s to couple a bin",
        "handling.uncoupling": f"{handling.uncoupling:g} s to uncouple it",
    }
    if scenario.bays > 1:
        words["bays"] = f"{scenario.bays} carriers unload at a time"
    if handling.exchange:
        words["handling.exchange"] = f"{handling.exchange:g} s with the empty bin"
    return words | _load_out_words(scenario)


def _load_out_words(scenario: Scenario) -> dict[str, str]:
    """Return the load-out, trailers, truck and empty bins: key of the scenario -> words."""
    words = _way_words(scenario)
    trailers = scenario.load_out.trailers
    if trailers.count is not None and trailers.bins is not None:
        words["load_out.trailers.count"] = counted("trailers", trailers.count)
        words["load_out.trailers.bins"] = f"{counted('bins', trailers.bins)} on a trailer"
    truck = scenario.load_out.truck
    if truck.every is not None and truck.bins is not None:
        words["load_out.truck.every"] = f"a truck every {truck.every:g} s"
        words["load_out.truck.bins"] = f"{counted('bins', truck.bins)} on a truck"
    empty_bins = scenario.load_out.empty_bins
    if empty_bins is not None:
        words["load_out.empty_bins"] = f"{counted('empty bins', empty_bins)} at the bay"
    return words


def _way_words(scenario: Scenario) -> dict[str, str]:
    """Return the way to the load-out: key of the scenario -> words; {} if bins stay at the bay."""
    load_out = scenario.load_out
    if load_out.seconds_away is not None:
        return {"load_out.seconds_away": f"{load_out.seconds_away:g} s away at the load-out"}
    if load_out.metres is None:
        return {}
    return {
        "load_out.metres": f"a load-out {load_out.metres:g} m away",
        "load_out.speed": f"{load_out.speed:g} m/s on the way to the load-out",
        "load_out.seconds": f"{load_out.seconds:g} s there",
    }


def _rows_words(scenario: Scenario, varied: Collection[str]) -> str:
    """Return how many rows there are, how long they are, and what fills a bin."""
    words = "rows"
    if "rows" not in varied:
        words = f"{scenario.rows} rows"
    if scenario.survey:
        words += ", as surveyed"
    elif "row_length" not in varied:
        words += f" of {scenario.row_length:g} m"
    if not _keys_of_bins(scenario).isdisjoint(varied):
        return words
    if scenario.bin_metres:
        return f"{words}, a bin every {scenario.bin_metres:.3g} m"
    return f"{words}, one bin a row"


def _keys_of_bins(scenario: Scenario) -> set[str]:
    """Return the keys of which it hangs how many metres of a row fill a bin."""
    keys = {"metres_per_bin", "bins_per_row"}
    if scenario.crop.tonnes_per_hectare is not None:
        keys |= {"crop", "crop.tonnes_per_hectare", "crop.kilograms_per_bin", "row_width"}
    if scenario.bins_per_row is not None:
        keys.add("row_length")
    return keys


def _rate_words(scenario: Scenario, varied: Collection[str]) -> str:
    """Return how fast pickers are; '' if the scenario gives no rate, or it varies."""
    rate = scenario.picking_rate
    if not rate or "picking_rate" in varied:
        return ""
    return f" at {rate:g} bins an hour"

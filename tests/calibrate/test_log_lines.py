"""A log of bins that a person has written: what is read, and what is told of wrong lines.

Each line says when a bin was full, fetched or unloaded, and names its picker, row and carrier, as
far as the person knows them. Times that are read are seconds since midnight.
"""

import pytest

from orchard.calibrate.bins import bins_of
from orchard.calibrate.log_lines import read_log
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, WorkShift

# Two bins of Ana; the second one is not unloaded yet.
GOOD = """\
time,event,picker,row,carrier
2026-04-14T07:40:00,full,Ana,3,T1
2026-04-14T07:44:00,fetched,Ana,3,T1
2026-04-14T07:50:30,unloaded,Ana,3,T1
2026-04-14T08:20:00,full,Ana,3,
2026-04-14T08:21:00,fetched,Ana,3,T2
"""
DAY = WorkShift(begin="07:00", end="16:00", breaks=(("10:00", "10:15"), ("12:00", "12:45")))


def read(tmp_path, text: str):
    """Write a log, and read it."""
    path = tmp_path / "log.csv"
    path.write_text(text)
    return read_log(path)


def faults(tmp_path, text: str) -> list[str]:
    """Return what is wrong with each line, from the line's number on."""
    try:
        bins_of(read(tmp_path, text), WorkShift())
    except ScenarioError as error:
        prefix = f"{tmp_path / 'log.csv'}:"
        return [str(problem).removeprefix(prefix) for problem in error.problems]
    return []


def changed(line: int, text: str) -> str:
    """Return the good log with another line. Lines count from 1; "" leaves it out."""
    lines = GOOD.splitlines()
    lines[line - 1] = text
    return "\n".join(line for line in lines if line) + "\n"


def test_each_bin_has_its_three_times(tmp_path):
    first, second = bins_of(read(tmp_path, GOOD), WorkShift()).bins
    assert first.picker == "Ana"
    assert first.row == "3"
    assert first.carrier == "T1"
    hour = 3600.0
    # At 7:40, 4 minutes later, and 10.5 minutes later.
    assert first.full == 7 * hour + 2400.0
    assert first.fetched == first.full + 240.0
    assert first.unloaded == first.full + 630.0
    assert second.carrier == "T2"
    assert second.unloaded is None


def test_other_names_of_columns_and_events_are_known(tmp_path):
    text = (
        "Timestamp;Action;Worker;Row No.;Tractor;weather\n"
        "2026-04-14 07:40;Filled;Ana;3;;dry\n"
        "2026-04-14 07:44;picked up;Ana;3;T1;dry\n"
    )
    log = read(tmp_path, text)
    assert [line.event for line in log.lines] == ["full", "fetched"]
    assert log.lines[1].carrier == "T1"
    assert log.notes == ["columns that are not used: weather"]


def test_breaks_are_no_working_time(tmp_path):
    text = changed(3, "2026-04-14T13:40:00,fetched,Ana,3,T1").replace("T07:50:30", "T13:50:30")
    text = text.replace("2026-04-14T08:20:00,full,Ana,3,\n", "")
    text = text.replace("2026-04-14T08:21:00,fetched,Ana,3,T2\n", "")
    (bin_,) = bins_of(read(tmp_path, text), DAY).bins
    # From 7:40 to 13:40 are 6 h, in which both breaks are 1 h.
    assert bin_.fetched - bin_.full == 6 * 3600.0 - 3600.0


@pytest.mark.parametrize(
    ("line", "text", "words"),
    [
        (
            3,
            "2026-04-14T07:30:00,fetched,Ana,3,T1",
            "3: fetched at 2026-04-14 07:30:00, and no bin of Ana is full then; a bin must be full"
            " before it is fetched",
        ),
        (
            4,
            "2026-04-14T07:42:00,unloaded,Ana,3,T1",
            "4: unloaded at 2026-04-14 07:42:00, and no bin of Ana is on its way then (line 2: its"
            " last one was full); a bin must be fetched before it is unloaded",
        ),
        (
            4,
            "2026-04-14T07:50:30,unloaded,Ana,3,T9",
            "4: unloaded at 2026-04-14 07:50:30, and no bin of Ana is on its way then (line 3: its"
            " last one was fetched); a bin must be fetched before it is unloaded",
        ),
        (
            4,
            "2026-04-14T07:44:00,fetched,Ana,3,T1",
            "4: says what line 3 says; leave out one of both",
        ),
        (
            5,
            "2026-04-14T07:20:00,full,Ana,3,",
            "5: time = 2026-04-14 07:20:00: goes back: Ana has full at 2026-04-14 07:40:00 on line"
            " 2; times of one picker must go on from line to line",
        ),
        (
            4,
            "14/4/2026 7:50,unloaded,Ana,3,T1",
            "4: time = 14/4/2026 7:50: must be a date and a time of day, such as"
            " 2026-04-14T07:12:30",
        ),
        (
            4,
            "2026-04-14,unloaded,Ana,3,T1",
            "4: time = 2026-04-14: must be a date and a time of day, such as 2026-04-14T07:12:30",
        ),
        (
            4,
            "2026-04-14T07:50:30,unladed,Ana,3,T1",
            "4: event = unladed: must be full, fetched or unloaded; did you mean unloaded?",
        ),
        (
            2,
            "2026-04-14T07:40:00,full,,,T1",
            "2: has neither picker nor row; must say whose bin it is",
        ),
    ],
)
def test_a_wrong_line_is_told_with_its_number(tmp_path, line, text, words):
    assert words in faults(tmp_path, changed(line, text))


def test_all_wrong_lines_are_told_at_once(tmp_path):
    text = changed(2, "noon,full,Ana,3,T1").replace("08:20:00,full", "08:20:00,fall")
    assert [fault.split(":")[0] for fault in faults(tmp_path, text)] == ["2", "5"]


def test_lines_of_another_zone_are_told_with_their_time(tmp_path):
    text = GOOD.replace(":00,", ":00+12:00,").replace(":30,", ":30+12:00,")
    text = text.replace("2026-04-14T08:21:00+12:00", "2026-04-13T20:21:00Z")
    assert faults(tmp_path, text) == [
        "6: time = 2026-04-13T20:21:00+00:00: is in another time zone than line 2, which has"
        " +12:00; write 2026-04-14T08:21:00+12:00"
    ]


def test_a_line_without_the_zone_of_the_others_is_told(tmp_path):
    text = GOOD.replace(":00,", ":00+12:00,").replace("T07:50:30", "T07:50:30+12:00")
    text = text.replace("T08:21:00+12:00", "T08:21:00")
    assert faults(tmp_path, text) == [
        "6: time = 2026-04-14T08:21:00: is in another time zone than line 2, which has +12:00;"
        " write 2026-04-14T08:21:00+12:00 if the clock is the same"
    ]


def test_the_end_of_summer_time_is_no_second_zone(tmp_path):
    """In New Zealand it ends on 5 April 2026: from +13:00 to +12:00 in the log of two days."""
    day = "2026-04-0{day}T07:{minute}:00+{hours}:00,{event},Ana,3,T1"
    lines = ["time,event,picker,row,carrier"]
    for number, hours in ((4, 13), (5, 12)):
        lines.append(day.format(day=number, hours=hours, minute=40, event="full"))
        lines.append(day.format(day=number, hours=hours, minute=44, event="fetched"))
    bins = bins_of(read(tmp_path, "\n".join(lines)), WorkShift()).bins
    # Both are full at 7:40 by the clock of their day.
    assert [bin_.full for bin_ in bins] == [7 * 3600.0 + 2400.0] * 2


def test_a_file_without_its_columns_says_which_are_missing(tmp_path):
    (fault,) = faults(tmp_path, "when,who\n2026-04-14T07:40,Ana\n")
    assert "names no column event and no column picker or row: when, who" in fault
    assert "time,event,picker,row,carrier" in fault


def test_an_empty_log_says_what_lines_it_must_have(tmp_path):
    (fault,) = faults(tmp_path, "time,event,picker\n")
    assert "has no line below its names" in fault


def test_a_missing_fetch_is_told_and_spoils_no_other_bin(tmp_path):
    text = changed(3, "").replace("2026-04-14T07:50:30,unloaded,Ana,3,T1\n", "")
    text += "2026-04-14T09:00:00,full,Ana,3,\n2026-04-14T09:02:00,fetched,Ana,3,T1\n"
    logged = bins_of(read(tmp_path, text), Scenario().shift)
    # At 8:21 and 9:02.
    assert [bin_.fetched for bin_ in logged.bins] == [None, 30060.0, 32520.0]
    assert logged.gaps == [
        f"{tmp_path / 'log.csv'}:2: this bin of Ana was not fetched before the next one was full:"
        " a line with fetched is missing; its times are left out"
    ]


def test_a_time_without_any_event_is_told(tmp_path):
    """There is an event every two minutes, and none from 7:58 to 9:00: 62 min, or 3,720 s."""
    lines = ["time,event,picker"]
    for minute in [*range(0, 60, 2), *range(120, 180, 2)]:
        hour, rest = divmod(7 * 60 + minute, 60)
        event = "full" if minute % 4 == 0 else "fetched"
        lines.append(f"2026-04-14T{hour:02}:{rest:02}:00,{event},Ana")
    logged = bins_of(read(tmp_path, "\n".join(lines)), WorkShift())
    (gap,) = logged.gaps
    assert gap.startswith(f"{tmp_path / 'log.csv'}:32: no event from 07:58 (line 31) to 09:00:")
    assert [silence.end - silence.begin for silence in logged.silences] == [3720.0]


def carried_log(missing: int, days: int = 2) -> str:
    """Return a log of a carrier with ten bins a day, each with three lines.

    `missing`: the bin, from 0, whose line with unloaded is missing.
    """
    lines = ["time,event,picker,row,carrier"]
    for number in range(10 * days):
        day = 14 + number // 10
        hour = 7 + number % 10
        lines.append(f"2026-04-{day}T{hour:02}:10:00,full,Ana,{number + 1},")
        lines.append(f"2026-04-{day}T{hour:02}:11:00,fetched,Ana,{number + 1},T1")
        if number != missing:
            lines.append(f"2026-04-{day}T{hour:02}:14:00,unloaded,,,T1")
    return "\n".join(lines)


@pytest.mark.parametrize("missing", [1, 9, 18])
def test_a_missing_unload_spoils_no_other_drive(tmp_path, missing):
    """Each drive takes 3 minutes, from :11 to :14. Bin 9 is the last one of the first day."""
    logged = bins_of(read(tmp_path, carried_log(missing)), WorkShift())
    # s from fetched to unloaded; None where that is not known.
    drives = [bin_.unloaded and bin_.unloaded - bin_.fetched for bin_ in logged.bins]
    expected = [180.0] * 20
    expected[missing] = None
    assert drives == expected
    assert logged.gaps == [
        f"{tmp_path / 'log.csv'}:{3 * missing + 2}: this bin of Ana was never unloaded: a line with"
        " unloaded is missing; its drive is left out"
    ]


def test_the_last_bin_of_a_picker_is_told_as_not_unloaded(tmp_path):
    """The carrier T2 fetches the next bin, so it has unloaded Ana's second one unseen."""
    text = GOOD + "2026-04-14T08:25:00,full,Ben,4,\n2026-04-14T08:30:00,fetched,Ben,4,T2\n"
    text += "2026-04-14T08:35:00,unloaded,,,T2\n"
    logged = bins_of(read(tmp_path, text), WorkShift())
    # At 7:50:30 and 8:35.
    assert [bin_.unloaded for bin_ in logged.bins] == [28230.0, None, 30900.0]
    assert logged.gaps == [
        f"{tmp_path / 'log.csv'}:5: this bin of Ana was never unloaded: a line with unloaded is"
        " missing; its drive is left out"
    ]


def test_lines_with_no_name_in_common_are_not_matched(tmp_path):
    text = changed(2, "2026-04-14T07:40:00,full,Ana,,")
    text = text.replace("fetched,Ana,3,T1", "fetched,,3,T1")
    assert faults(tmp_path, text)[0] == (
        "3: fetched at 2026-04-14 07:44:00, and no bin of row 3 is full then (line 2 has no picker"
        " and no row in common; name one in both); a bin must be full before it is fetched"
    )


def test_names_of_one_bin_may_stand_on_different_lines(tmp_path):
    text = changed(3, "2026-04-14T07:44:00,fetched,,3,T1").replace("unloaded,Ana,3", "unloaded,,")
    text = text.replace("full,Ana,3,T1", "full,Ana,3,")
    assert bins_of(read(tmp_path, text), WorkShift()).bins[0].unloaded == 28230.0


def test_lines_may_end_as_on_an_old_macintosh(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(GOOD.replace("\n", "\r").encode())
    assert read_log(path).lines == read(tmp_path, GOOD).lines


def test_a_first_line_without_end_is_told(tmp_path):
    (fault,) = faults(tmp_path, "a" * 200_000)
    assert fault.startswith("1: names no columns: field larger than field limit (131072). It must")


def test_a_time_that_another_zone_cannot_have_is_told(tmp_path):
    text = GOOD.replace(":00,", ":00+12:00,").replace(":30,", ":30+12:00,")
    text = text.replace("2026-04-14T08:21:00+12:00", "9999-12-31T23:30:00-12:00")
    (fault,) = faults(tmp_path, text)
    assert fault.endswith("+12:00; write a time of the years 1 to 9999 with +12:00")


def test_long_names_that_begin_alike_are_not_the_same(tmp_path):
    """Names are shortened in messages only."""
    team = "picker of the orchard Kaimai North of the team "
    row = "https://farm.example/orchards/kaimai-north/"
    text = GOOD.replace("Ana,3", f"{team}Ana,{row}3")
    text += f"2026-04-14T08:25:00,full,{team}Ben,{row}4,\n"
    bins = bins_of(read(tmp_path, text), WorkShift()).bins
    assert {bin_.picker for bin_ in bins} == {f"{team}Ana", f"{team}Ben"}
    assert {bin_.row for bin_ in bins} == {f"{row}3", f"{row}4"}
    # A message shows at most 200 letters of a name.
    text += f"2026-04-14T08:26:00,full,{300 * 'x'},{row}4,\n"
    text += f"2026-04-14T08:25:30,full,{300 * 'x'},{row}5,\n"
    (fault,) = faults(tmp_path, text)
    assert f"goes back: {197 * 'x'}... has full" in fault


def test_times_outside_the_working_day_are_refused(tmp_path):
    log = read(tmp_path, GOOD.replace("T07:", "T19:").replace("T08:", "T20:"))
    with pytest.raises(ScenarioError) as caught:
        bins_of(log, DAY)
    assert str(caught.value) == (
        f"{log.file}:2: 5 of 5 lines, this one first, lie outside the working day of the scenario,"
        " 07:00 to 16:00 (shift); write the times of the orchard's own clock, not of UTC"
    )


def test_work_that_goes_on_over_midnight_is_refused(tmp_path):
    text = GOOD.replace("14T07:", "13T23:").replace("14T08:", "14T00:")
    assert faults(tmp_path, text) == [
        "5: work goes on over midnight, from 2026-04-13 23:50:30 (line 4) to 2026-04-14 00:20:00;"
        " a day's work must lie in one day: write the times of the orchard's own clock, not of UTC"
    ]


def test_a_line_of_more_cells_than_names_is_told(tmp_path):
    text = changed(2, "2026-04-14T07:40:00,full,Kaimai, team Ana,3,T1")
    assert faults(tmp_path, text) == [
        "2: has 6 cells below 5 names; a cell with a separator in it must stand in quotes:"
        ' "Ana, team 2"'
    ]
    assert faults(tmp_path, changed(2, "2026-04-14T07:40:00,full,Ana,3,T1,,")) == []

"""The form: a control for each value of a scenario, what is wrong there, and own classes."""

from collections.abc import Mapping, Sequence

from nicegui import ui

from orchard.app.control import Control
from orchard.app.conversion import conversion_words
from orchard.app.draft import Draft
from orchard.app.elements import button, heading, note
from orchard.app.entries import entries, flat, words_of
from orchard.app.own_classes import AGENTS
from orchard.field.scenario import Scenario

# Title of a group -> the paths of its entries.
ROWS = "Your rows"
GROUPS = {
    ROWS: (
        "rows",
        "row_length",
        "row_width",
        "crop.tonnes_per_hectare",
        "crop.kilograms_per_bin",
        "pickers",
        "picking_rate",
    ),
    "Fleet and prices": (
        "carriers",
        "dispatch",
        "prices.picker_per_hour",
        "prices.carrier_per_hour",
        "prices.overhead_per_hour",
        "prices.per_bin",
    ),
    "The day": (
        "shift.begin",
        "shift.end",
        "shift.breaks",
        "prices.picker_per_bin",
        "prices.picker_least_per_day",
        "prices.carrier_per_day",
        "prices.overhead_per_day",
    ),
}
# Groups that are folded away: what not every grower has to say.
CREW_AND_HAUL = {
    "The crew": ("picker_rates", "picker_absences", "rows_to_pickers"),
    "From the bay on": (
        "load_out.metres",
        "load_out.speed",
        "load_out.seconds",
        "load_out.seconds_away",
        "load_out.trailers.count",
        "load_out.trailers.bins",
        "load_out.truck.every",
        "load_out.truck.bins",
        "load_out.empty_bins",
    ),
    "Machines that are bought": (
        "prices.picker_bought.price",
        "prices.picker_bought.years",
        "prices.picker_bought.hours_per_year",
        "prices.carrier_bought.price",
        "prices.carrier_bought.years",
        "prices.carrier_bought.hours_per_year",
    ),
}
FOR_EXPERTS = {
    "Robots": ("route", "order_in_row", "seed"),
    "Bins and picking speed": ("bins_per_row", "metres_per_bin", "picking_speed"),
    "Picking": (
        "picking.driving_speed",
        "picking.turning",
        "picking.spread.distribution",
        "picking.spread.cv",
        "picking.spread_of_pickers.distribution",
        "picking.spread_of_pickers.cv",
        "picking.spread_of_bins.distribution",
        "picking.spread_of_bins.cv",
        "picking.failure.mean_between",
        "picking.failure.mean_repair",
    ),
    "Carriers": (
        "carrying.speed",
        "carrying.turning",
        "handling.coupling",
        "handling.uncoupling",
        "handling.exchange",
        "handling.unloading",
        "bays",
        "carrying.failure.mean_between",
        "carrying.failure.mean_repair",
        "chargers",
        "carrying.battery.hours",
        "carrying.battery.standing",
        "carrying.battery.hours_to_charge",
        "carrying.battery.reserve",
    ),
    "People and animals": ("people.workers", "people.visitors", "animals.dogs", "animals.cats"),
    "Surroundings": ("weeds", "tractor"),
    "Sensors": (
        "laser.noise",
        "sensors.gnss.white",
        "sensors.gnss.bias",
        "sensors.gnss.bias_time",
        "sensors.odometry.distance",
        "sensors.odometry.heading",
    ),
}
CREW_TITLE = "Crew, haul, machines that are bought"
EXPERTS_TITLE = "For experts"
_OF_CREW_AND_HAUL = set[str]().union(*CREW_AND_HAUL.values())
# What is seen while the part for experts is folded away.
_ALWAYS_SEEN = {*AGENTS}.union(*GROUPS.values())


class Form:
    """All controls of a draft, and the user's own classes, if there are any.

    The controls of crew and haul, and those for experts, are folded away.
    """

    def __init__(self, draft: Draft) -> None:
        """`draft`: what the controls show, and what they enter into."""
        self._draft = draft
        self._controls: dict[str, Control] = {}
        # Title of a group -> its box.
        self._boxes: dict[str, ui.element] = {}
        self._add(GROUPS)
        with self._boxes[ROWS]:
            self._conversion = ui.label().classes("conversion")
            self._conversion.props("data-view=conversion role=status")
        with ui.expansion(CREW_TITLE).classes("experts").props("data-view=crew") as self._crew:
            self._add(CREW_AND_HAUL)
        with (
            ui.expansion(EXPERTS_TITLE)
            .classes("experts")
            .props("data-view=experts") as self._experts
        ):
            self._add(FOR_EXPERTS)
            self._add({"More": tuple(path for path in entries() if path not in self._controls)})
        with _group("Own classes") as self._classes:
            self._names = ui.label().classes("classes").props("data-view=classes")
            self._problem = note("data-problem=agents role=alert")
            button(
                "Use the built-in classes", draft.drop_classes, "drop-classes", props="flat dense"
            )
        self._classes.set_visibility(False)

    def _add(self, groups: Mapping[str, Sequence[str]]) -> None:
        """Add controls. `groups`: title -> the paths of its entries."""
        for title, paths in groups.items():
            self._boxes[title] = _group(title)
            with self._boxes[title]:
                for path in paths:
                    self._controls[path] = Control(entries()[path], self._draft)

    def show(self) -> None:
        """Show the values of the draft."""
        for path, value in self._draft.values.items():
            self._controls[path].show(value)

    def follow(self, running: Scenario | None) -> None:
        """Show what follows from the values that are entered.

        That is what is wrong, what the program has chosen, and how the scenario that runs differs.
        """
        draft = self._draft
        for path, control in self._controls.items():
            control.follow(draft.values[path])
            control.complain()
        self._mark_differences(running)
        self._count_what_is_folded_away()
        if draft.scenario is not None:
            self._show_chosen(draft.scenario)
        folded_away = set(draft.problems) - _ALWAYS_SEEN
        if folded_away & _OF_CREW_AND_HAUL:
            self._crew.open()
        if folded_away - _OF_CREW_AND_HAUL:
            self._experts.open()
        self._follow_classes()

    def _count_what_is_folded_away(self) -> None:
        """Say how many values in the folded parts are not as in the default orchard.

        A preset sets some there, and they stay when a user types other rows over it.
        """
        default = flat(Scenario())
        own = set[str]()
        for path, value in self._draft.values.items():
            if value != default[path]:
                own.add(path)
        own -= _ALWAYS_SEEN
        self._crew.set_text(folded_title(CREW_TITLE, len(own & _OF_CREW_AND_HAUL)))
        self._experts.set_text(folded_title(EXPERTS_TITLE, len(own - _OF_CREW_AND_HAUL)))

    def _mark_differences(self, running: Scenario | None) -> None:
        """Mark the values that the scenario that runs has not. None: no scenario runs."""
        running_values = {} if running is None else flat(running)
        for path, control in self._controls.items():
            is_same = running_values.get(path) == self._draft.values[path]
            if running is None or is_same:
                control.mark("")
            else:
                control.mark(words_of(path, running_values[path]))

    def _show_chosen(self, scenario: Scenario) -> None:
        """Show the numbers that the program works out where the user has entered none."""
        chosen = scenario.chosen
        for path, number in chosen.items():
            self._controls[path].show_chosen(number)
        self._conversion.set_text(conversion_words(scenario))

    def _follow_classes(self) -> None:
        """Show the user's own classes, and what is wrong with them."""
        classes = self._draft.classes
        self._classes.set_visibility(bool(classes))
        self._names.set_text("\n".join(f"{key}: {path}" for key, path in classes.items()))
        problems = []
        for path, text in self._draft.problems.items():
            if path.split(".")[0] in AGENTS:
                problems.append(text)
        self._problem.set_text("\n".join(problems))


def folded_title(title: str, own: int) -> str:
    """Return the title of a folded part. `own`: how many of its values are not the default.

    >>> folded_title("For experts", 2), folded_title("For experts", 0)
    ('For experts (2 set)', 'For experts')
    """
    if not own:
        return title
    return f"{title} ({own} set)"


def _group(title: str) -> ui.element:
    """Add a group of controls. Return its box."""
    with ui.element("section").classes("group") as group:
        heading(2, title).classes("group-title")
    return group

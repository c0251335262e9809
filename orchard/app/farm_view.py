"""A farm: blocks that are added from the form, the way between them, and how many carriers."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from orchard.app.answer_view import INVALID, LOOK_SECONDS, AnswerView
from orchard.app.desks import Desk
from orchard.app.draft import title_of
from orchard.app.elements import button, labelled, table
from orchard.app.farm_run import (
    BLOCKS_LABEL,
    NAME_LABEL,
    TOO_FEW,
    TRANSFER_LABEL,
    AddedBlock,
    FarmRun,
    Farms,
)
from orchard.app.page_words import BUDGET_LABEL
from orchard.app.typed_field import TypedField
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.study.farm_words import heads_and_lines, legend

QUESTION = "How many carriers for all blocks?"
HINT = (
    "One fleet harvests several blocks, one after another. Set the form to the rows of a block,"
    " name it, and add it; then the next one. The pickers are those of the form."
)
# How a field for a text looks.
TEXT = "dense outlined autocomplete=off input-class=figure"


class FarmView(AnswerView):
    """The blocks, the fields and the answer. All pages share one farm at a time."""

    def __init__(
        self,
        farms: Farms,
        desk: Desk,
        drafted: Callable[[], Scenario | None],
        take: Callable[[Scenario, str], Awaitable[None]],
    ) -> None:
        """`drafted`: gives the form's scenario; None if it is invalid. `take`: sets the form."""
        self._desk = desk
        self._drafted = drafted
        self._take = take
        self._settings = desk.farm
        with ui.element("div").classes("study-fields"):
            self._build_fields()
        self._blocks = ui.element("div").classes("summary sides").props("data-view=farm-blocks")
        super().__init__(farms, "farm", QUESTION, HINT)
        self._show_blocks()
        self._update()
        ui.timer(LOOK_SECONDS, self._watch)

    # -- the fields

    def _build_fields(self) -> None:
        with labelled(NAME_LABEL), ui.element("div").classes("field-body"):
            self._name = TypedField()
            self._name.props(f'{TEXT} data-field=farm-name aria-label="{NAME_LABEL}"')
            self._name.props('placeholder="such as Top"')
            self._name.on("keydown.enter", self._add)
            button("Add the rows of the form", self._add, "farm-add", "add", "outline dense")
        self._number(TRANSFER_LABEL, "transfer", self._settings.transfer)
        self._number(BUDGET_LABEL, "budget", self._settings.budget)

    def _number(self, label: str, name: str, value: str) -> None:
        """Add a field for a number. `name`: of the setting."""

        def enter(event: ValueChangeEventArguments[Any]) -> None:
            # A cleared field holds None.
            self._enter(**{name: event.value or ""})

        with labelled(label):
            text = ui.input(value=value, on_change=enter).classes("number")
            text.props(
                f'{TEXT} inputmode=decimal data-field=farm-{name} aria-label="{label}"',
            )

    def _enter(self, **settings: Any) -> None:
        """Take what a user has changed, and tell what is wrong with it."""
        self._settings = replace(self._settings, **settings)
        self._desk.farm = self._settings
        self._update()

    # -- the blocks

    def _add(self) -> None:
        """Add the form's orchard as a block, or tell why not."""
        scenario = self._drafted()
        name = self._name.value.strip()
        problem = self._settings.problem_of_name(name)
        if scenario is None:
            problem = INVALID
        if scenario is None or problem:
            self._trouble.set_text(problem)
            return
        self._enter(blocks=(*self._settings.blocks, AddedBlock(name, scenario)))
        self._name.set_value("")
        self._show_blocks()

    def _remove(self, number: int) -> None:
        """Take a block out of the farm."""
        blocks = list(self._settings.blocks)
        del blocks[number]
        self._enter(blocks=tuple(blocks))
        self._show_blocks()

    async def _use(self, number: int) -> None:
        """Set the form to a block."""
        block = self._settings.blocks[number]
        await self._take(block.scenario, block.name)

    def _show_blocks(self) -> None:
        """Show the blocks in their order, each with its buttons."""
        blocks = self._settings.blocks

        def add_buttons(number: int) -> None:
            name = blocks[number].name
            use = partial(self._use, number)
            remove = partial(self._remove, number)
            for words, act in (("Set the form", use), ("Remove", remove)):
                action = f"farm-{words.split()[0].lower()}-{number}"
                added = button(words, act, action, props="flat dense")
                added.props["aria-label"] = f"{words}: {name}"

        lines = [(block.name, title_of(block.scenario)) for block in blocks]
        self._blocks.clear()
        if lines:
            with self._blocks:
                table(lines, ("block", "rows"), add_buttons)

    # -- the question

    @property
    def _problem(self) -> str:
        return self._settings.problem

    def _problem_now(self) -> str:
        if self._settings.problem:
            return self._settings.problem
        if len(self._settings.blocks) < 2:
            return f"{BLOCKS_LABEL}: {TOO_FEW}"
        if self._drafted() is None:
            return INVALID
        return ""

    def _begin(self) -> None:
        scenario = self._drafted()
        assert scenario is not None
        try:
            self._commands.start(partial(FarmRun, self._settings, scenario.pickers))
        except ScenarioError as error:
            texts = "; ".join(problem.text for problem in error.problems)
            raise RuntimeError(f"{BLOCKS_LABEL}: {texts}") from None

    def _is_as_asked(self, own: FarmRun) -> bool:
        scenario = self._drafted()
        is_same_crew = scenario is not None and scenario.pickers == own.pickers
        return is_same_crew and own.settings == self._settings

    def _progress(self, command: FarmRun) -> tuple[float, str]:
        if not command.now:
            return 0.0, ""
        return command.share, f"{command.now}: {command.setting_count} settings so far."

    # -- the answer

    async def _show_result(self, command: FarmRun) -> None:
        result = command.result
        if result is None or not result.table:
            return
        heads, lines = heads_and_lines(result)
        self._show_table("Settings", heads, lines, legend(result))

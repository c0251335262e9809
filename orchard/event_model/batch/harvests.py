"""Many harvests of one orchard that stop for decisions, each with a seed of its own."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model import columns
from orchard.event_model.batch import columns as bc
from orchard.event_model.batch.entry import addresses, step
from orchard.event_model.bystanders import LOOKING, STANDING, WAY, Bystanders
from orchard.event_model.draws import has_failures
from orchard.event_model.known import refuse_unknown
from orchard.event_model.start import STATE, Prepared, prepare
from orchard.field.layout import Layout
from orchard.field.picking import FAILING, picking_speed_of
from orchard.field.rows import RULES
from orchard.field.scenario import Scenario
from orchard.plans.routes import ROUTES
from orchard.sim.kernels.arrays import WORDS

# Ticks, far beyond any harvest, that a column can hold.
MOST_TICKS = 2**62
# Draws of each kind for which a robot has room at first.
ROOM = 32
# Arrays of a state begin at multiples of so many bytes.
ALIGNED = 64
# Of each kind what stands in a draw before the robot's name.
DRAWN = {bc.FAILING: FAILING, bc.WAY: WAY, bc.STANDING: STANDING, bc.LOOKING: LOOKING}
# Arrays that hold draws, and are replaced by longer ones.
DRAWS = ("failures", "encounters", "looks")


def refuse_what_seeds_change(scenario: Scenario) -> None:
    """Raise ValueError for classes of the user's own that may do otherwise with each seed: all
    harvests of a batch share a program.
    """
    own = {}
    if scenario.route not in ROUTES:
        own["route"] = scenario.route
    if scenario.rows_to_pickers not in RULES:
        own["rows_to_pickers"] = scenario.rows_to_pickers
    for key, path in own.items():
        raise ValueError(
            f"{key} = {path}: a batch of harvests knows built-in ones only; use dispatch_env"
        )


class HarvestBatch:
    """Harvests that `step` carries on to their next decisions.

    `arrays` are what compiled code reads and writes: see `batch.columns.ARRAYS`.
    """

    def __init__(
        self,
        layout: Layout,
        count: int,
        *,
        is_early: bool,
        longest: int,
        bin_order: Sequence[str],
        carrier_order: Sequence[str],
    ) -> None:
        """`is_early`: whether bins report before they are full. `longest`: ticks of an episode.
        `bin_order`, `carrier_order`: names, as observations have them.

        Raises ValueError for what the model does not know, and for what a batch does not know.
        """
        refuse_unknown(layout.scenario)
        refuse_what_seeds_change(layout.scenario)
        self._scenario = layout.scenario
        # The picker of each row.
        self._pickers = {}
        for picker, block in layout.blocks.items():
            for row in block.rows:
                self._pickers[row] = picker
        prepared = prepare(layout)
        prepared.program.translate_all()
        initial = _initial(prepared, is_early)
        # Arrays that no harvest changes.
        shared = initial._asdict() | prepared.program.arrays()
        self._shared = {}
        for name in columns.ARRAYS:
            if name not in (*STATE, *DRAWS, "speeds"):
                self._shared[name] = np.asarray(shared[name])
        # Of each array of a state its shape, and its bytes.
        self._state_forms = {}
        for name in STATE:
            array = getattr(initial, name)
            self._state_forms[name] = (array.shape, array.nbytes)
        state = _as_bytes(initial)
        self._pass_speeds = prepared.program.pass_speeds
        # (harvests, passes) m/s at which pickers pick on each pass.
        self._speeds = np.tile(self._pass_speeds.in_layout(layout), (count, 1))
        bystanders = Bystanders.of(layout)
        self.arrays = {
            "initial": state,
            "states": np.tile(state, (count, 1)),
            "episodes": np.zeros(count, bc.EPISODE),
            "rules": _rules(layout, bystanders, prepared.program.bins, longest),
            **_decisions(prepared, count, bin_order, carrier_order),
            **_draws(prepared.names, bystanders),
        }
        for name in DRAWS:
            self.arrays[name] = np.zeros((count, 0), bc.ARRAYS[name][0])
        self._widen(ROOM)

    # -- what is done

    def begin(self, number: int, seed: int) -> None:
        """Let a harvest begin anew in the next step, with a seed."""
        self.arrays["commands"][number] = bc.BEGIN
        self.arrays["episodes"]["seed"][number] = seed
        if self._scenario.work_is_drawn:
            scenario = self._scenario.model_copy(update={"seed": seed})
            of_rows = np.zeros(len(self._pickers))
            for row, picker in self._pickers.items():
                of_rows[row - 1] = picking_speed_of(scenario, row, picker)
            self._speeds[number] = self._pass_speeds.drawn(scenario, of_rows)

    def act(self, do_act: np.ndarray, actions: np.ndarray) -> None:
        """Let some harvests do their actions in the next step.

        `do_act`: (n,) bool, these harvests. `actions`: (n,), numbers of actions, of all harvests.
        """
        self.arrays["commands"][do_act] = bc.ACT
        self.arrays["actions"][do_act] = actions[do_act]

    def step(self) -> None:
        """Carry all harvests on to their next decisions."""
        count = len(self.arrays["episodes"])
        done = step(self._batch, 0)
        while done < count:
            self._widen(2 * self._room)
            done = step(self._batch, done)

    # -- where the arrays are

    def _widen(self, room: int) -> None:
        """Make room for so many draws of each kind for each robot."""
        self._room = room
        count = len(self._speeds)
        for name in DRAWS:
            longer = np.zeros((count, room * self._robots), bc.ARRAYS[name][0])
            before = self.arrays[name]
            longer[:, : before.shape[1]] = before
            self.arrays[name] = longer
        self._find()

    @property
    def _robots(self) -> int:
        """The number of robots of a harvest."""
        return len(self.arrays["nearness"])

    def _find(self) -> None:
        """Note where all arrays are."""
        count = len(self._speeds)
        words = np.zeros((count, len(columns.ARRAYS), WORDS), np.int64)
        harvests = np.arange(count)
        begin = self.arrays["states"].ctypes.data
        for name in STATE:
            shape, size = self._state_forms[name]
            _note(words, name, begin + harvests * self.arrays["states"].strides[0], shape)
            # As `_as_bytes` has put them.
            begin += size + -size % ALIGNED
        for name, array in self._shared.items():
            _note(words, name, array.ctypes.data, array.shape)
        speeds = self._speeds
        _note(words, "speeds", speeds.ctypes.data + harvests * speeds.strides[0], speeds.shape[1:])
        for name in DRAWS:
            draws = self.arrays[name]
            places = draws.ctypes.data + harvests * draws.strides[0]
            _note(words, name, places, (self._robots, 0))
            # The second length, after the address and the first one: draws that a robot has.
            words[:, [*columns.ARRAYS].index(name), 2] = self.arrays["episodes"][name]
        self.arrays["addresses"] = words.reshape(count, -1)
        self._batch = addresses(self.arrays)

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the addresses of the arrays, which are those of this process."""
        state = {name: value for name, value in vars(self).items() if name != "_batch"}
        arrays = {name: array for name, array in self.arrays.items() if name != "addresses"}
        return state | {"arrays": arrays}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be a batch that goes on from a state."""
        vars(self).update(state)
        self._find()


def _as_bytes(model: columns.Model) -> np.ndarray:
    """Return the arrays of a state, one after the other, as bytes.

    Each is followed by zeros, so that the next one begins at a multiple of ALIGNED.
    """
    parts = []
    for name in STATE:
        part = np.frombuffer(getattr(model, name).tobytes(), np.uint8)
        parts += [part, np.zeros(-len(part) % ALIGNED, np.uint8)]
    return np.concatenate(parts)


def _note(words: np.ndarray, name: str, places: Any, shape: tuple[int, ...]) -> None:
    """Note where an array of each harvest is, and its shape."""
    number = [*columns.ARRAYS].index(name)
    words[:, number, 0] = places
    words[:, number, 1 : 1 + len(shape)] = shape


def _initial(prepared: Prepared, is_early: bool) -> columns.Model:
    """Return a model at the start of a harvest that stops for each decision."""
    desk = prepared.model.desk.copy()
    desk.policy = c.IN_PYTHON_EARLY if is_early else c.IN_PYTHON
    return prepared.model._replace(desk=desk)


def _rules(layout: Layout, bystanders: Bystanders, bins: int, longest: int) -> np.ndarray:
    """Return what all harvests have in common."""
    rules = np.zeros(1, bc.RULES)
    rules["longest"] = min(longest, MOST_TICKS)
    rules["bins"] = bins
    rules["has_failures"] = has_failures(layout.scenario)
    rules["has_people"] = bool(bystanders.density)
    if bystanders.density:
        rules["metres"] = bystanders.metres
    return rules


def _decisions(
    prepared: Prepared, count: int, bin_order: Sequence[str], carrier_order: Sequence[str]
) -> dict[str, np.ndarray]:
    """Return the arrays of what is told and done."""
    bins = len(bin_order)
    carriers = len(carrier_order)
    bin_places = [bin_order.index(name) for name in prepared.bin_names]
    return {
        "commands": np.zeros(count, np.int64),
        "actions": np.zeros(count, np.int64),
        "chosen": np.full((count, len(prepared.names)), c.NONE),
        "bin_places": np.array(bin_places),
        "carriers": np.array([prepared.names.index(name) for name in carrier_order]),
        "seconds_seen": np.zeros((count, 1), np.float32),
        "bins_seen": np.zeros((count, bins, bc.OF_BIN), np.float32),
        "carriers_seen": np.zeros((count, carriers, bc.OF_CARRIER), np.float32),
        "masks": np.zeros((count, 1 + bins * carriers), np.int8),
        "happened": np.zeros((count, 3)),
    }


def _draws(names: Sequence[str], bystanders: Bystanders) -> dict[str, np.ndarray]:
    """Return the arrays with which compiled code draws."""
    texts = {}
    for kind, before in DRAWN.items():
        for robot, name in enumerate(names):
            texts[kind, robot] = (before + name).encode()
    longest = max(map(len, texts.values()))
    letters = np.zeros((bc.DRAWN, len(names), longest), np.uint8)
    lengths = np.zeros((bc.DRAWN, len(names)), np.int64)
    for (kind, robot), text in texts.items():
        letters[kind, robot, : len(text)] = np.frombuffer(text, np.uint8)
        lengths[kind, robot] = len(text)
    nearness = [
        [bystanders.nearness(name, is_towing) for is_towing in (False, True)] for name in names
    ]
    return {
        "names": letters,
        "lengths": lengths,
        "nearness": np.array(nearness),
        "text": np.zeros(128, np.uint8),
        "words": np.zeros(32, np.uint64),
        "chances": np.zeros(2),
    }

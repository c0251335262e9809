"""The bodies: their shapes, and what changes about them from time to time: state, bin's fill, bar, weeds."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import rerun as rr

from orchard.field.kinds import ANIMALS, KINDS, PEOPLE
from orchard.field.layout import ROW_LENGTH, Layout
from orchard.field.placement import Start
from orchard.view import palette
from orchard.view.mesh import MeshPart, mesh_of
from orchard.view.scenery import archetype
from orchard.view.shapes import FLAG, body

GROUPS = {"person": PEOPLE, "animal": ANIMALS}  # kinds that share a branch of world/
PINNED = ("picker", "carrier", "tractor")
PIN_Z = 4.4  # m: well above the pergola
SHORT = {"picker": "P", "carrier": "C", "tractor": "T"}
SCAN_COLOURS = {"picker": (255, 0, 200), "carrier": (0, 150, 255), "tractor": (255, 40, 30)}
OTHER_SCANS = (250, 250, 120)

BIN_FLOOR, BIN_RIM = 0.2, 0.94  # z between which the fruit stands, m
FILL_STEPS = 14
WHOLE, UNSEEN = (1.0, 1.0, 1.0), (0.01, 0.01, 0.01)  # scales
NAME_ASIDE = 3.0  # m to the left, of every other robot's name on the plan: those of a queue do not cover each other
FRUIT = [MeshPart("cab", (0.88, 0.88, 1.0), (0, 0, -0.5), palette.KIWI), *(
    MeshPart("ball", (0.3, 0.3, 0.24), (x, y, 0.0), palette.KIWI_FLESH if (i + j) % 2 else palette.KIWI)
    for i, x in enumerate((-0.27, 0.0, 0.27)) for j, y in enumerate((-0.27, 0.0, 0.27))
)]  # fmt: skip


def path_of(start: Start) -> str:
    """Where a body lives in the recording: world/pickers/picker_01."""
    group = next((group for group, kinds in GROUPS.items() if start.kind in kinds), start.kind)
    return f"world/{'people' if group == 'person' else group + 's'}/{start.name}"


class BodyView:
    """The bodies' entities; every method logs at the time that is set on the stream, and only what has changed."""

    def __init__(self, rec: rr.RecordingStream, layout: Layout) -> None:
        self.rec, self.layout = rec, layout
        self.path = {start.name: path_of(start) for start in layout.starts}
        self._said: dict[str, dict[str, palette.Colour]] = {s.name: {} for s in layout.starts if s.kind != "weed"}
        self._level = dict.fromkeys((s.name for s in layout.starts if s.kind == "bin"), -1)
        # None: unknown, for a further part of a recording begins with what was to be seen at the end of the part before.
        self._barred: dict[int, bool | None] = dict.fromkeys(i for i, s in enumerate(layout.starts) if KINDS[s.kind].tows)
        self._weeds: dict[int, bool | None] = dict.fromkeys(i for i, s in enumerate(layout.starts) if s.kind == "weed")
        for start in layout.starts:
            self._introduce(start)

    def remember(self, said: Mapping[str, Sequence[str]]) -> None:
        """What they were said to do in the parts of the recording before, by their paths: its colours stay."""
        for name in self._said:
            self._said[name] = {words: palette.colour_of(words) for words in said.get(f"/{self.path[name]}", ())}

    def _introduce(self, start: Start) -> None:
        """What never changes about a body: its frame, shape, pin and the look of its scan. (A weed's shape is not for ever.)"""
        path, frame = self.path[start.name], rr.CoordinateFrame(start.name)
        self.rec.log(path, frame, static=True)
        if start.kind != "weed":
            self.rec.log(path, archetype(mesh_of(body(start.kind))), static=True)
        if start.kind in PINNED:
            self._pin(start)
        if start.kind == "bin":
            self.rec.log(f"{path}/fruit", frame, archetype(mesh_of(FRUIT)), static=True)
            self.rec.log(f"{path}/full", frame, archetype(mesh_of(FLAG)), static=True)
        colour = SCAN_COLOURS.get(start.kind, OTHER_SCANS)
        self.rec.log(f"scans/{start.name}", frame, rr.Points3D.from_fields(colors=[colour], radii=[0.1]), static=True)

    def _pin(self, robot: Start) -> None:
        """A ball on a stalk, above the canopy, in the colour of what the robot does."""
        path, top = f"pins/{robot.name}", max(PIN_Z, KINDS[robot.kind].height + 2.0)
        ball = rr.Points3D([(0.0, 0.0, top)], labels=[robot.name])
        stalk = rr.LineStrips3D([[(0.0, 0.0, KINDS[robot.kind].height), (0.0, 0.0, top)]], colors=[palette.WIRE], radii=[0.04])
        self.rec.log(path, rr.CoordinateFrame(robot.name), ball, stalk, static=True)
        self.rec.log(path, rr.Points3D.from_fields(colors=[palette.STATES[palette.RESTING]]))
        self._name(robot, top)

    def _name(self, robot: Start, z: float) -> None:
        """The short name on the plan: P03."""
        number = robot.name[-2:]
        place = (0.0, NAME_ASIDE * (int(number) % 2 if robot.kind == "carrier" else 0), z)
        word = rr.Points3D([place], labels=[SHORT[robot.kind] + number], show_labels=True, radii=[0.01], colors=[palette.ROAD_EDGE])
        self.rec.log(f"plan/names/{robot.name}", rr.CoordinateFrame(robot.name), word, static=True)

    def doing(self, name: str, text: str) -> None:
        """A body does something else now: its lane in the timeline, and the colour of its pin. A weed only grows, and has none."""
        path, colour, known = self.path.get(name), palette.colour_of(text), self._said.get(name)
        if path is None or known is None:
            return
        text = text or palette.RESTING
        if text not in known:
            known[text] = colour
            self.rec.log(path, rr.StateConfiguration(values=list(known), colors=list(known.values())), static=True)
        self.rec.log(path, rr.StateChange(state=text))
        if self.layout.starts[self.layout.index[name]].kind in PINNED:
            self.rec.log(f"pins/{name}", rr.Points3D.from_fields(colors=[colour]))

    def fills(self, fill: np.ndarray) -> None:
        """How high the fruit stands in each bin; `fill` in metres of row, one per body."""
        for name, level in self._level.items():
            now = int(np.ceil(FILL_STEPS * fill[self.layout.index[name]] / ROW_LENGTH - 1e-9))
            if now != level:
                self._level[name] = now
                self._fruit(name, now)

    def _fruit(self, name: str, level: int) -> None:
        path = f"{self.path[name]}/fruit"
        z = BIN_FLOOR + (BIN_RIM - BIN_FLOOR) * level / FILL_STEPS
        scale = (1.0, 1.0, z - 0.17) if level else UNSEEN
        self.rec.log(path, rr.InstancePoses3D(translations=[(0.0, 0.0, z)], scales=[scale]))
        self.rec.log(f"{self.path[name]}/full", rr.InstancePoses3D(scales=[WHOLE if level >= FILL_STEPS else UNSEEN]))

    def bars(self, coupled: np.ndarray) -> None:
        """The bar between a robot and its bin, while they are coupled; `coupled` is an index or -1 for each body."""
        for i, barred in self._barred.items():
            now = bool(coupled[i] >= 0)
            if now != barred:
                self._barred[i] = now
                self._bar(self.layout.starts[i], now)

    def _bar(self, robot: Start, there: bool) -> None:
        kind = KINDS[robot.kind]
        ends = [(-kind.length / 2 + 0.1, 0.0, 0.42), (-kind.tows + 0.45, 0.0, 0.42)]
        strips = rr.LineStrips3D([ends] if there else [], colors=[palette.BAR], radii=[0.09])
        self.rec.log(f"{self.path[robot.name]}/bar", rr.CoordinateFrame(robot.name), static=True)
        self.rec.log(f"{self.path[robot.name]}/bar", strips)

    def weeds(self, alive: np.ndarray) -> None:
        """Weeds grow where they are alive, and are gone where they are not."""
        for i, grown in self._weeds.items():
            now, path = bool(alive[i]), self.path[self.layout.names[i]]
            if now and not grown:
                self.rec.log(path, archetype(mesh_of(body("weed"))))
            if not now and grown is not False:
                self.rec.log(path, rr.Clear(recursive=False))
            self._weeds[i] = now

    def scanned(self, kinds: Iterable[str]) -> list[int]:
        """The bodies of these kinds, as places in the world's arrays."""
        wanted = set(kinds)
        return [i for i, start in enumerate(self.layout.starts) if start.kind in wanted]

"""The plan of a run as it is now, which Jupyter shows."""

import re
import xml.etree.ElementTree as Xml

from local_runs import local_at

from orchard.report.plan import PIXELS


def drawn(svg):
    """title -> the rectangle that has it."""
    boxes = Xml.fromstring(svg).iter("{http://www.w3.org/2000/svg}rect")
    return {box[0].text: box for box in boxes if len(box)}


def test_the_plan_shows_where_the_bodies_are_and_what_is_picked():
    before, run = local_at(0), local_at(400)
    begin, now = drawn(before._repr_svg_()), drawn(run._repr_svg_())
    pose = run.engine.observe()["picker_01"].pose
    shift = float(now["picker_01"].get("x")) - float(begin["picker_01"].get("x"))
    assert abs(shift / PIXELS - (pose.x - before.engine.observe()["picker_01"].pose.x)) < 0.01
    picked = {float(metres) for name in now for metres in re.findall(r"row \d: (\S+) m picked", name)}
    assert picked == {round(metres, 1) for metres in run.engine.world.row_picked.tolist()}
    assert max(picked) > 30.0


def test_a_flattened_weed_is_not_drawn():
    run = local_at(0)
    run.engine.world.alive[run.engine.layout.index["weed_01"]] = False
    assert {"weed_01"} == drawn(local_at(0)._repr_svg_()).keys() - drawn(run._repr_svg_()).keys()

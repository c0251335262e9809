"""The bodies of an orchard by kind, and their descriptions in URDF. Figures: keyspace.md; of heights and colours: docs/reference.md."""

from typing import NamedTuple
from xml.etree import ElementTree as Xml

from orchard_ros2 import topics

ROBOTS = ("bin", "carrier", "picker", "tractor")


class Kind(NamedTuple):
    """The properties of all bodies of a kind. A body is a box."""

    length: float  #: m, along x
    width: float  #: m
    height: float  #: m
    colour: tuple[int, int, int]  #: sRGB
    laser_ahead: float  #: its laser ahead of its centre, m
    tows: float = 0.0  #: the centre of its coupled bin behind its own, m; 0: it tows nothing


KINDS = {
    "picker": Kind(2.5, 1.5, 1.0, (238, 130, 238), 1.25, 2.25),
    "carrier": Kind(1.8, 1.5, 0.5, (0, 170, 255), 0.9, 1.9),
    "bin": Kind(1.0, 1.0, 1.0, (178, 34, 34), 0.0),
    "tractor": Kind(5.0, 3.0, 3.0, (220, 30, 30), 2.5),
    "worker": Kind(0.55, 1.0, 1.7, (34, 139, 34), 0.275),
    "visitor": Kind(0.55, 1.0, 1.7, (127, 255, 212), 0.275),
    "dog": Kind(1.0, 0.8, 0.7, (128, 128, 128), 0.5),
    "cat": Kind(1.0, 0.8, 0.7, (255, 140, 0), 0.5),
    "weed": Kind(0.5, 0.5, 0.5, (60, 160, 40), 0.0),
}


def kind_of(name: str) -> str:
    """Return the kind in a name: "picker" for "picker_01"; the name itself if it has no number."""
    return name.rsplit("_", 1)[0]


def selected(bodies: list[str], words: list[str]) -> list[str]:
    """Return those of the bodies that are named, or are of a named kind, in their order. Raises ValueError for words that fit none."""
    wrong = [word for word in words if not any(word in (name, kind_of(name)) for name in bodies)]
    if wrong:
        raise ValueError(f"robots: {', '.join(wrong)}: no such body or kind in this run; there are {', '.join(bodies)}")
    return [name for name in bodies if name in words or kind_of(name) in words]


def description(name: str) -> str:
    """Return the URDF of a body. Its links are named as its frames on /tf; base_link is at the middle of the box, on the ground."""
    kind, robot = KINDS[kind_of(name)], Xml.Element("robot", name=name)
    base = Xml.SubElement(robot, "link", name=topics.base_link(name))
    for part in ("visual", "collision"):
        shape = Xml.SubElement(base, part)
        Xml.SubElement(shape, "origin", xyz=f"0 0 {kind.height / 2}", rpy="0 0 0")
        Xml.SubElement(Xml.SubElement(shape, "geometry"), "box", size=f"{kind.length} {kind.width} {kind.height}")
        if part == "visual":
            material = Xml.SubElement(shape, "material", name=kind_of(name))
            Xml.SubElement(material, "color", rgba=" ".join(f"{level / 255:.3f}" for level in kind.colour) + " 1")
    Xml.SubElement(robot, "link", name=topics.laser(name))
    joint = Xml.SubElement(robot, "joint", name=f"{name}/laser_joint", type="fixed")
    Xml.SubElement(joint, "parent", link=topics.base_link(name))
    Xml.SubElement(joint, "child", link=topics.laser(name))
    Xml.SubElement(joint, "origin", xyz=f"{kind.laser_ahead} 0 {topics.LASER_HEIGHT}", rpy="0 0 0")
    return Xml.tostring(robot, encoding="unicode")

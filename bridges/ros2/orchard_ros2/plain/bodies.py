"""The bodies of an orchard: their kinds, in their names, and their descriptions in URDF."""

from collections.abc import Collection, Sequence
from xml.etree import ElementTree as Xml

from . import topics


def kind_of(name: str) -> str:
    """Return the kind in a name: "picker" for "picker_01"."""
    return name.rsplit("_", 1)[0]


def selected(words: Sequence[str], names: Sequence[str], kinds: Collection[str]) -> list[str]:
    """Return those of the bodies that are named, or are of a named kind, in their order.

    A kind may be without a body in this run.

    `names`: all bodies; `kinds`: all kinds. Raises ValueError for words that are neither.
    """
    unknown = [word for word in words if word not in names and word not in kinds]
    if unknown:
        raise ValueError(
            f"{', '.join(unknown)}: no such body or kind; there are {', '.join(names)}"
        )
    return [name for name in names if name in words or kind_of(name) in words]


def description(name: str, size: Sequence[float], colour: Sequence[int], laser_ahead: float) -> str:
    """Return the URDF of a body.

    Its links are named as its frames on /tf; base_link is at the middle of the box, on the ground.

    `size`: length, width, height of its box, m; `colour`: sRGB, 0 to 255; `laser_ahead`: its laser
    ahead of its centre, m.
    """
    robot = Xml.Element("robot", name=name)
    base = Xml.SubElement(robot, "link", name=topics.base_link(name))
    for part in ("visual", "collision"):
        shape = Xml.SubElement(base, part)
        Xml.SubElement(shape, "origin", xyz=f"0 0 {size[2] / 2}", rpy="0 0 0")
        Xml.SubElement(Xml.SubElement(shape, "geometry"), "box", size=" ".join(map(str, size)))
    material = Xml.SubElement(base[0], "material", name=kind_of(name))
    levels = " ".join(f"{level / 255:.3f}" for level in colour)
    Xml.SubElement(material, "color", rgba=f"{levels} 1")
    Xml.SubElement(robot, "link", name=topics.laser(name))
    joint = Xml.SubElement(robot, "joint", name=f"{name}/laser_joint", type="fixed")
    Xml.SubElement(joint, "parent", link=topics.base_link(name))
    Xml.SubElement(joint, "child", link=topics.laser(name))
    Xml.SubElement(joint, "origin", xyz=f"{laser_ahead} 0 {topics.LASER_HEIGHT}", rpy="0 0 0")
    return Xml.tostring(robot, encoding="unicode")

"""Where the packages of the distribution are. All else is in pyproject.toml.

Some folders of a clone are parts of the package `orchard` only where it is installed. In a clone,
`orchard/__init__.py` and `orchard/bags/__init__.py` find them.
"""

from setuptools import find_namespace_packages, setup

ELSEWHERE = {
    "orchard.processes": "processes",
    "orchard.config": "config",
    "orchard.bags.plain": "bridges/ros2/orchard_ros2/plain",
}

found = find_namespace_packages(include=["orchard", "orchard.*"], exclude=["*.__pycache__*"])

setup(packages=[*found, *ELSEWHERE], package_dir=ELSEWHERE)

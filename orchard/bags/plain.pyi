# What type checkers see of `orchard.bags.plain` in a clone: they do not follow `__path__`.
from orchard_ros2.plain import bodies as bodies
from orchard_ros2.plain import cdr as cdr
from orchard_ros2.plain import field as field
from orchard_ros2.plain import messages as messages
from orchard_ros2.plain import topics as topics

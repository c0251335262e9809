# What type checkers see of `orchard.processes` in a clone: they do not follow `__path__`.
from processes import agents as agents
from processes import logger as logger
from processes import physics as physics
from processes import router as router

"""One hash for a whole run: two runs that are the same to the last bit have the same one, and no others."""

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from orchard.world import World

_NOTHING = np.zeros(0, dtype=np.float32)
_LITTLE = {kind: np.dtype(f"<{kind}") for kind in ("f8", "f4", "i8", "b1")}


class RunDigest:
    """SHA-256 over everything that a run decides, tick by tick: each tick's hash takes in the one before, so 32 bytes hold it all."""

    def __init__(self, state: bytes = bytes(32)) -> None:
        self.state = state

    def update(self, world: World, scans: Sequence[np.ndarray], mail_digests: Mapping[str, bytes]) -> None:
        """Take one tick in: the world, the scans given to the agents (float32), and name -> digest of the mail it heard."""
        sha = hashlib.sha256(self.state)
        sha.update(b"%d %d %d\n" % (world.tick, world.delivered, len(mail_digests)))
        for array in (world.pose, world.coupled, world.fill, world.row_picked, world.alive, np.concatenate([_NOTHING, *scans])):
            sha.update(_little_endian(array))
        for name in sorted(mail_digests):
            sha.update(b"%d %d " % (len(name.encode()), len(mail_digests[name])) + name.encode() + mail_digests[name])
        self.state = sha.digest()

    def hexdigest(self) -> str:
        """64 hexadecimal digits, of all ticks so far."""
        return self.state.hex()


def _little_endian(array: np.ndarray) -> memoryview:
    """An array's bytes, the same on every machine."""
    return np.ascontiguousarray(array, dtype=_LITTLE[array.dtype.kind + str(array.itemsize)]).data

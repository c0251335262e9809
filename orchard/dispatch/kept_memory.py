"""What a dispatch policy remembers from one decision to the next.

It is kept as bytes: the dispatcher sends it in its own memory, and a snapshot has it. So it must be
plain data, and come back as it was.
"""

from orchard.contract.agent import LARGEST_MEMORY
from orchard.contract.checks import NOT_PLAIN, PLAIN, place_of_fault
from orchard.contract.difference import difference
from orchard.contract.messages import pack, unpack
from orchard.dispatch.policy import Dispatch

# Bytes. It is sent in the dispatcher's memory, with the bins and the bookings.
LARGEST_POLICY_MEMORY = LARGEST_MEMORY // 2
ALLOWED = f"Use {PLAIN} that the policy's `Memory` names"


def as_kept(remembered: object, policy: Dispatch) -> bytes:
    """Return a policy's memory as it is kept.

    Raises TypeError if it is no plain data, if it does not fit its class, or if it would come back
    as another one, such as a tuple as a list; ValueError if it is too large.
    """
    packed = _packed(remembered)
    if len(packed) > LARGEST_POLICY_MEMORY:
        raise ValueError(
            f"the policy's memory takes {len(packed)} bytes; at most {LARGEST_POLICY_MEMORY}"
        )
    try:
        kept = unpack(packed, policy.Memory)
    except ValueError as error:
        text = f"the policy's memory does not fit its `Memory`, {policy.Memory}: {error}"
        raise TypeError(text) from None
    # Types too: a Counter equals the dict as which it would come back.
    change = difference(remembered, kept, "memory")
    if change:
        text = f"the policy's memory would be another one in its next decision: {change}"
        raise TypeError(f"{text}. {ALLOWED}")
    return packed


def _packed(remembered: object) -> bytes:
    """Return the bytes of a memory. Raises TypeError, with the part of it that is not plain."""
    try:
        return pack(remembered)
    except NOT_PLAIN as error:
        place = place_of_fault(remembered, "memory")
        raise TypeError(f"the policy's {place}: {error}. {ALLOWED}") from None

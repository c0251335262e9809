"""At which tick physics may go on: what the oracle says of another one."""

# The newest snapshots that physics keeps. One of them may be torn.
KEPT = 2


def wrong_begin(tick: int, kept: list[int], torn: set[int]) -> str:
    """Return what is wrong with the tick at which physics begins; empty if nothing is.

    It goes on from its newest snapshot, or from the one before if that is torn, and no earlier.
    `kept`: the ticks of the snapshots that were written, the newest last. `torn`: of those that
    were damaged since.
    """
    whole = [at for at in kept[-KEPT:] if at not in torn]
    if tick > 0 and tick not in kept:
        return f"physics goes on at tick {tick}, of which it has kept no snapshot"
    if whole and tick != whole[-1]:
        return f"physics went back to tick {tick}, though it has kept tick {whole[-1]}"
    return ""

"""At which tick physics may go on when it is started again. World (processes.py) checks it."""

# The newest snapshots that physics keeps. One of them may be torn.
KEPT = 2


def wrong_begin(tick: int, kept: list[int], torn: set[int]) -> str:
    """Return what is wrong with the tick at which physics begins; '' if nothing is.

    It must go on from its newest snapshot, or from the one before if the newest one is torn.
    `kept`: the ticks of the snapshots that were written, the newest last. `torn`: the ticks of
    those that were damaged since.
    """
    whole = [at for at in kept[-KEPT:] if at not in torn]
    if tick > 0 and tick not in kept:
        return f"physics goes on at tick {tick}, of which it has kept no snapshot"
    if whole and tick != whole[-1]:
        return f"physics went back to tick {tick}, though it has kept tick {whole[-1]}"
    return ""

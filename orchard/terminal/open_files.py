"""How many files this program may have open at once."""

import resource


def allow_files(needed: int, who_needs: str, otherwise: str = "") -> None:
    """Let this program open so many files. `who_needs`: what needs them, with its verb.

    Raises ValueError if the system does not allow it; `otherwise`: what can be done instead.
    """
    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed >= needed or allowed == resource.RLIM_INFINITY:
        return
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, most))
    except (ValueError, OSError):
        raise ValueError(
            f"this program may open {most} files at once, and {who_needs} {needed}; "
            f"`ulimit -n {needed}` allows them{otherwise}"
        ) from None

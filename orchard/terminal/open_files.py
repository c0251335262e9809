"""How many files this program may have open at once."""

import resource


def allow_files(needed: int, what_needs: str, otherwise: str = "") -> None:
    """Let this program open so many files at once.

    Raises ValueError if the system does not allow it. Its text holds `what_needs`, a subject and
    its verb such as "the page needs", and `otherwise`: what can be done instead.
    """
    # The present limit, and the most to which a program may raise it.
    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed >= needed or allowed == resource.RLIM_INFINITY:
        return
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, most))
    except (ValueError, OSError):
        raise ValueError(
            f"this program may open {most} files at once, and {what_needs} {needed}; "
            f"`ulimit -n {needed}` allows them{otherwise}"
        ) from None

"""The command `orchard` of a clone."""

import signal

if (
    __name__ == "__main__"
):  # Ctrl-C while the rest is imported ends the process silently: nothing runs yet
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from orchard.__main__ import main

if __name__ == "__main__":
    main()

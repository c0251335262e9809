"""Lines of a shell in which `orchard` is the program."""

import shlex
import subprocess
import sys
from pathlib import Path

from command_line import ROOT
from patience import PATIENCE


def shell(line: str, folder: Path) -> tuple[int, str]:
    """Run a line in which `orchard` is the program, in a folder.

    Return its exit code, and stderr. An error of Python or of Rust (Zenoh, Rerun) must not be seen.
    """
    program = shlex.join([sys.executable, str(ROOT / "run.py")])
    done = subprocess.run(
        ["bash", "-c", f'orchard() {{ {program} "$@"; }}; {line}'],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        timeout=PATIENCE,
    )
    assert "Traceback" not in done.stderr and "panicked" not in done.stderr, done.stderr
    return done.returncode, done.stderr

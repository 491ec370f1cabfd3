"""The command `weldpath`."""

from __future__ import annotations

import signal
import sys

from . import _weldpath


def main() -> int:
    """Does what the command line says, and returns the exit code."""
    # The command knows what to do with a signal; Python would wait for it to end.
    for which in (signal.SIGINT, signal.SIGTERM):
        # What a shell has this ignore stays ignored.
        if signal.getsignal(which) is not signal.SIG_IGN:
            signal.signal(which, signal.SIG_DFL)
    return _weldpath.command(["weldpath", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())

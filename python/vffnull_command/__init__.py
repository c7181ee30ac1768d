"""The command ``vffnull`` from its first moment on, before the package that does the work is imported.

An import can be interrupted nowhere without a traceback. Until the command can answer Ctrl-C itself, and once
its work is done, the process ends by the signal, as programs do by default.
"""

import signal

__all__ = ["main"]

_HEARD = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not in a shell's background
if _HEARD:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def main() -> None:
    """Run the command line and exit; see `vffnull.cli.main`."""
    from vffnull.cli import main as run

    try:
        if _HEARD:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:  # between the lines of the command's own answer
        raise SystemExit(128 + signal.SIGINT) from None
    finally:
        if _HEARD:
            signal.signal(signal.SIGINT, signal.SIG_DFL)

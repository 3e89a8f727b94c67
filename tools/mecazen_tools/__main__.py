"""The command line, `mecazen` or `python -m mecazen_tools`: Ctrl-C ends it quietly at any time."""

import io
import os
import signal
import sys

from mecazen_tools import INTERRUPTED


def main() -> None:
    """Run the command line; until it has been imported Ctrl-C ends the process at once."""
    interrupt = signal.getsignal(signal.SIGINT)
    if interrupt is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # NumPy's products are too small to need threads
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    if {"up", "--distributed"} & {*sys.argv}:
        from mecazen_tools.forking import start_server  # noqa: PLC0415

        start_server()  # which imports at the same time as this process
    from mecazen_tools.cli.app import main as run  # noqa: PLC0415  # takes a second
    from mecazen_tools.files import WholeWrites  # noqa: PLC0415

    if sys.stdout is not None:
        whole = WholeWrites(sys.stdout.fileno(), "w", closefd=False)
        sys.stdout = io.TextIOWrapper(whole, sys.stdout.encoding, "replace", write_through=True)

    signal.signal(signal.SIGINT, interrupt)
    try:
        run()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        # while a class is being made, as in a late import, Python raises another exception from it
        if isinstance(error.__cause__, KeyboardInterrupt):
            sys.exit(INTERRUPTED)
        raise


if __name__ == "__main__":
    main()

"""The start of the `tombo` command: Ctrl-C while Python still loads it ends it without a word."""

import gc
import signal

gc.set_threshold(100_000)  # to look for cycles after each 700 new objects is a tenth of a command

if __name__ != "__mp_main__":  # not in the processes of a pool, which never see Ctrl-C
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # bin/tombo has held it back


def run() -> None:
    """Run the command line of this process, and leave with its exit code."""
    from tombo_bringup.cli.main import run as run_command

    run_command()


if __name__ == "__main__":
    run()

"""The way in: signals and streams are taken care of before anything else is loaded."""

from __future__ import annotations

from ppmc.interrupts import hold_streams, install


def main() -> None:
    """Run the command line and leave with its exit code."""
    hold_streams()
    install()
    from ppmc.command_end import left_with

    def run() -> int:
        from ppmc.cli import run_command

        return run_command(None)

    left_with(run)


if __name__ == "__main__":
    main()

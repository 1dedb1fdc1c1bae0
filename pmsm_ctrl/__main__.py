"""``python -m pmsm_ctrl`` is ``pmsm-ctrl``."""

import sys

__all__ = ["main"]


def main() -> None:
    """Run ``pmsm-ctrl``; Ctrl-C while the command line is still being loaded is one line as well."""
    try:
        from pmsm_ctrl.cli import main as run
    except KeyboardInterrupt:
        print("pmsm-ctrl: interrupted; no incomplete file was written", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()

"""``python -m pmsm_ctrl`` is ``pmsm-ctrl``."""

import os
import sys

from pmsm_ctrl.threads import ONE_THREAD

__all__ = ["main"]


def main() -> None:
    """Run ``pmsm-ctrl``; Ctrl-C while the command line is still being loaded is one line as well."""
    for name, count in ONE_THREAD.items():  # before numpy is loaded, which reads them once
        os.environ.setdefault(name, count)
    try:
        from pmsm_ctrl.cli import main as run
    except KeyboardInterrupt:
        print("pmsm-ctrl: interrupted; no incomplete file was written", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()

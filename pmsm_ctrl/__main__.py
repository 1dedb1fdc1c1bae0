"""``python -m pmsm_ctrl`` is ``pmsm-ctrl``."""

from pmsm_ctrl.cli import main

if __name__ == "__main__":
    main()

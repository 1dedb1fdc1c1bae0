"""Comparison of a model with measurements: where it fails, and by how much."""

from pmsm_ctrl.compare import present as _present  # noqa: F401 - registers the section
from pmsm_ctrl.compare.comparison import ChannelError, Comparison, compare

__all__ = ["ChannelError", "Comparison", "compare"]

"""Physical effects, one file each, and the catalogue that lists them."""

from pmsm_ctrl.effects.base import SIGNALS, Effect, Parameter
from pmsm_ctrl.effects.catalogue import CATALOGUE, bound_effects, catalogue_of, catalogue_with, lookup
from pmsm_ctrl.kernels import kernel

__all__ = [
    "CATALOGUE", "SIGNALS", "Effect", "Parameter", "bound_effects", "catalogue_of", "catalogue_with", "kernel",
    "lookup",
]  # fmt: skip

"""How a term can be wired: one file each, with everything that depends on it."""

from pmsm_ctrl.effects.structures.bristle import Bristle
from pmsm_ctrl.effects.structures.delay import Delay
from pmsm_ctrl.effects.structures.gap import Gap
from pmsm_ctrl.effects.structures.interface import LogView, Search, SecondMass, Structure, UnavailableError
from pmsm_ctrl.effects.structures.spring import Spring
from pmsm_ctrl.effects.structures.term import Term
from pmsm_ctrl.effects.structures.transmission import Transmission

# In the order in which the drive kernel carries their memory; a spring and a gap share one, as transmissions.
STRUCTURES: tuple[type[Structure], ...] = (Term, Transmission, Bristle, Delay)

__all__ = [
    "STRUCTURES", "Bristle", "Delay", "Gap", "LogView", "Search", "SecondMass", "Spring", "Structure", "Term",
    "UnavailableError",
]  # fmt: skip

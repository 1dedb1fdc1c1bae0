"""The plants on which a gain is judged: that of the design, and the same one with presliding where it has none."""

from __future__ import annotations

from dataclasses import dataclass

from pmsm_ctrl.compensate.motions import at_speed
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects, presliding

__all__ = ["AT_REST", "DEFLECTION", "Judged", "bristle_trials", "judged", "sweep_trials", "with_bristle"]

AT_REST = ("positioning", "push")
# Breakaway deflection of the assumed bristle, rad and m. Published presliding displacements of bearings and ball screws
# are 1 to 50 um (B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083); 10 um on the radius
# of 20 mm of a bearing are 0.5 mrad.
DEFLECTION = {"rotary": 5e-4, "linear": 1e-5}


@dataclass(frozen=True)
class Judged:
    """One motion on which a gain is judged.

    Attributes
    ----------
    trial : str
        Its name among the trials of the study.
    plant : Design
    at_rest : bool
        Whether the limit cycle alone counts: the RMS error depends mostly on where the axis happens to stop.
    assumed : bool
        Whether the plant has presliding that the design does not state.
    """

    trial: str
    plant: Design
    at_rest: bool
    assumed: bool = False


def sweep_trials(plant: Design) -> tuple[str, ...]:
    """Return the trials on which every gain is judged."""
    return at_speed("reversal", 2.0, plant), at_speed("creep", 1.0, plant), *AT_REST


def bristle_trials(plant: Design) -> tuple[str, ...]:
    """Return the trials in which the first moments of a motion count: those on a plant with presliding."""
    return at_speed("reversal", 0.5, plant), *AT_REST


def with_bristle(plant: Design) -> Design | None:
    """Return a plant with the presliding that is assumed where nothing is known of it.

    Parameters
    ----------
    plant : Design

    Returns
    -------
    Design or None
        None where it has presliding already, or no dry friction.
    """
    present = [effect for effect, values in bound_effects(plant) if effect.active(values)]
    if any(effect.structure.replaces_direction for effect in present) or not any(effect.dry for effect in present):
        return None
    bristle = presliding.effect
    values = {**bristle.example, bristle.amplitudes[0]: DEFLECTION[plant.motion]}
    return plant.with_effect(bristle.id, values)


def judged(plant: Design) -> dict[str, Judged]:
    """Return the motions on which a gain is judged, by name, each with its plant.

    Parameters
    ----------
    plant : Design

    Returns
    -------
    dict of str to Judged
    """
    found = {name: Judged(name, plant, name in AT_REST) for name in sweep_trials(plant)}
    bristled = with_bristle(plant)
    if bristled is not None:
        tried = bristle_trials(plant)
        found |= {f"{name}, with presliding": Judged(name, bristled, name in AT_REST, assumed=True) for name in tried}
    return found

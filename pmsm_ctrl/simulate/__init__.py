"""The nonlinear, sampled drive: plant, controller and sensors in one kernel, a `Log` out of it."""

from pmsm_ctrl.simulate.batch import simulate_batch
from pmsm_ctrl.simulate.motions import INPUTS, Scenario
from pmsm_ctrl.simulate.parameters import Controller, Plant
from pmsm_ctrl.simulate.run import simulate
from pmsm_ctrl.simulate.scenarios import SCENARIOS, scenario

__all__ = ["INPUTS", "SCENARIOS", "Controller", "Plant", "Scenario", "scenario", "simulate", "simulate_batch"]

"""The four parameters of EMPS by mujoco's `sysid`: output error over restarted windows of a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record

__all__ = ["fitted"]

Array = NDArray[np.float64]

WINDOW = 1.0  # s: over a longer one the position is the random walk of a tiny force
# A mass on a slide with viscous and dry friction; a constant force is the actuator's bias.
AXIS = """
<mujoco>
  <option timestep="{period}" gravity="0 0 0" integrator="implicitfast"><flag contact="disable"/></option>
  <worldbody><body name="load"><inertial pos="0 0 0" mass="100" diaginertia="1 1 1"/>
    <joint name="slide" type="slide" axis="1 0 0" damping="100" frictionloss="10"/></body></worldbody>
  <actuator><general name="force" joint="slide" gainprm="1" biastype="affine" biasprm="0 0 0"/></actuator>
  <sensor><jointpos name="theta" joint="slide"/><jointvel name="omega" joint="slide"/></sensor>
</mujoco>
"""
# start, least, greatest
START = {"J": (100.0, 20.0, 300.0), "F_v": (100.0, 0.0, 1000.0), "F_c": (10.0, 0.0, 100.0), "T_0": (0.1, -30.0, 30.0)}


def fitted(log: Log, record: Record) -> Mapping[str, float]:
    """Return mass, viscous and Coulomb friction and constant load, kg, N s/m and N.

    A window starts at the measured position and the speed of the conditioned log; position and speed are its output.
    """
    import mujoco
    from mujoco import sysid

    spec = mujoco.MjSpec.from_string(AXIS.format(period=log.period))
    model = spec.compile()
    theta, omega, n = log["theta"], record.signals["omega"], round(WINDOW * log.rate)
    t = np.arange(n) * log.period
    starts = range(n, len(log) - 2 * n, n)
    sequences = sysid.ModelSequences(
        "axis", spec, [f"window {k}" for k in starts],
        [sysid.create_initial_state(model, theta[k : k + 1], omega[k : k + 1], np.zeros(0)) for k in starts],
        [sysid.TimeSeries(t, log["torque"][k : k + n, None]) for k in starts],
        [sysid.TimeSeries.from_names(t, np.column_stack([theta, omega])[k : k + n], model) for k in starts],
    )  # fmt: skip
    parameters = sysid.ParameterDict()
    for name, (start, low, high) in START.items():
        parameters.add(sysid.Parameter(name, start, low, high, modifier=partial(_put, _PUT[name])))
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    with redirect_stdout(StringIO()):  # it prints its iterations
        found, _ = sysid.optimize(parameters, residual, verbose=False)
    return {name: float(found[name].value[0]) for name in START}


def _put(setter: Callable[[Any, float], None], spec: Any, parameter: Any) -> None:
    setter(spec, float(parameter.value[0]))


def _mass(spec: Any, value: float) -> None:
    spec.body("load").mass = value


def _damping(spec: Any, value: float) -> None:
    spec.joint("slide").damping = np.array([value, 0.0, 0.0])


def _friction(spec: Any, value: float) -> None:
    spec.joint("slide").frictionloss = value


def _load(spec: Any, value: float) -> None:
    bias = np.array(spec.actuator("force").biasprm)
    bias[0] = -value
    spec.actuator("force").biasprm = bias


_PUT = {"J": _mass, "F_v": _damping, "F_c": _friction, "T_0": _load}

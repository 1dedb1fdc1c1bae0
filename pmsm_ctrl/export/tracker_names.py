"""Names and units of the exported tracker: what the compiled filter's arrays and variables are called in a program.

The filter keeps its fixed numbers and what it carries from sample to sample in arrays; in a program each is a variable
or a constant of its own. A unit in front of a comma is that of a rotary axis.
"""

from __future__ import annotations

from pmsm_ctrl.track import model

__all__ = ["AS_THEY_ARE", "EVENTS", "MEMORY", "NOTES", "SECTIONS", "SETTINGS", "STATES", "VECTORS"]

_ORDER = "speed, F_c, F_v, T_load, J, angle"
_UNITS = "rad/s, N m, N m s/rad, N m, kg m^2, rad"

# arrays of the compiled filter: name in its source -> name in the program, shape, meaning
VECTORS = {
    "x": ("state", (model.SIZE,), f"{_UNITS}: estimates of {_ORDER}"),
    "P": ("covariance", (model.SIZE, model.SIZE), f"products of the units of the state: covariance of {_ORDER}"),
    "a": ("jacobian", (model.SIZE,), "rad/s per unit of the state: change of the predicted speed with each state"),
    "u": ("work_u", (model.SIZE,), "covariance with the predicted speed, or with the innovation"),
    "v": ("work_v", (model.SIZE,), "covariance with the innovation after the first half of the update"),
    "h": ("measured_row", (model.SIZE,), "change of the predicted measurement with each state"),
    "K": ("kalman_gain", (model.SIZE,), "change of each state per unit of the innovation"),
}
# stretches of the array of fixed numbers that loops run over
SECTIONS = {
    "DRIFT": ("drift_variance", f"per s, variance that the random walk adds: squares of {_UNITS}"),
    "PRIOR": ("prior_variance", f"variance before the first sample: squares of {_UNITS}"),
}
# the other fixed numbers
SETTINGS = {
    "R": ("MEASUREMENT_VARIANCE", "rad^2 or (rad/s)^2, variance of the measured angle or speed"),
    "TORQUE_DENSITY": ("TORQUE_DENSITY", "(N m)^2 s, density of the torque's noise"),
    "LAG": ("SPEED_LAG", "s, lag of the drive's speed"),
    "SPEED_NOISE": ("SPEED_NOISE", "rad/s rms, noise of the measured speed"),
    "THRESHOLD": ("STANDSTILL_SPEED", "rad/s, below it the axis counts as standing"),
    "INTERVAL": ("UPDATE_INTERVAL", "s between two measurement updates"),
    "MAX_GAP": ("MAX_GAP", "s, longest step that is bridged"),
    "GATE": ("OUTLIER_GATE", "1, normalised innovation squared above which a measurement is rejected"),
    "J_NOMINAL": ("INERTIA", "kg m^2, inertia of the design"),
    "ADAPTS": ("ADAPTS", "1 where the noise of the torque follows the innovations, else 0"),
}
# constants of the filter's source
AS_THEY_ARE = {
    "SPREAD_TIME": "s, over which the spread of the speed is judged",
    "SPREAD_LIMIT": "1, relative spread of the speed below which F_c and F_v are not separable",
    "REJECTS_ARE_CHANGE": "1, rejected measurements in a row that count as a change of the axis",
    "TREND_WEIGHT": "1, weight of a new innovation in the mean of their signs",
    "TREND_LIMIT": "1, mean of normalised innovations above which friction has changed",
    "CALM_TIME": "s of motion after a change before the next one is detected",
    "EXCESS_WEIGHT": "1, weight of a new innovation in their mean square",
    "EXCESS_MOST": "1, largest square in that mean",
    "EXCESS_LIMIT": "1, mean square of innovations above which the noise is raised",
}
# what is carried from sample to sample
MEMORY = {
    "T_LAST": ("last_time", "s, time of the last valid sample"),
    "Z_LAST": ("last_measured", "rad or rad/s, last measured angle or speed"),
    "TORQUE_LAST": ("last_torque", "N m, drive's torque less the known load, last sample"),
    "KNOWN_LAST": ("last_known", "N m, torque of further effects, last sample"),
    "SPEED_LAST": ("last_speed", "rad/s, speed of the last sample"),
    "RUNNING": ("running", "1 while the filter follows a motion, else 0"),
    "ELAPSED": ("elapsed", "s since the last measurement update was due"),
    "MEAN": ("mean_speed", "rad/s, running mean of the speed's magnitude"),
    "SPREAD": ("speed_spread", "(rad/s)^2, running variance of the speed's magnitude"),
    "REJECTS": ("rejects", "1, rejected measurements in a row"),
    "DT": ("step_time", "s since the last valid sample"),
    "SPEED": ("speed", "rad/s, measured speed"),
    "TORQUE": ("mean_torque", "N m, mean torque over the step"),
    "KNOWN": ("mean_known", "N m, mean torque of further effects over the step"),
    "SURGE": ("surge", "N m, change of the torque over the step"),
    "DUE": ("due", "1 where a measurement update is due, else 0"),
    "TREND": ("trend", "1, running mean of signed normalised innovations"),
    "CALM": ("calm", "s of motion since the last change of the axis"),
    "SEEN": ("seen", "1 once the last speed is known, else 0"),
    "PAST_SPEED": ("past_speed", "rad/s, mean speed up to the last update"),
    "PAST_ALPHA": ("past_alpha", "rad/s^2, mean acceleration up to the last update"),
    "MOVED": ("moved_angle", "rad, angle turned since the last update"),
    "SPEED_USED": ("used_speed", "rad/s, measured speed at the last update"),
    "SINCE": ("since_update", "s of motion since the last update"),
    "EXCESS": ("excess", "1, running mean square of the innovations' scatter"),
    "NOISE": ("noise_factor", "1, factor on the density of the torque's noise"),
    "SIGNED": ("last_innovation", "1, last normalised innovation in the direction of motion"),
    "TORQUE_MEAN": ("running_torque", "N m, running mean of the torque over one interval"),
    "DEPARTURE": ("departure", "(N m)^2, square of the torque's distance from its mean, beyond the noise"),
    "GROWN": ("departure_grown", "(N m)^2, growth of the departure over the step"),
}
STATES = ("OMEGA", "F_C", "F_V", "T_LOAD", "INERTIA", "THETA")
EVENTS = ("PREDICTED", "UPDATED", "CONSTANT", "STANDSTILL", "STARTED", "REJECTED", "IMPLAUSIBLE", "INVALID", "GAP",
          "CHANGE")  # fmt: skip

# variables of the flattened functions
NOTES = {
    "torque": "N m, torque of the drive",
    "drive": "N m, torque of the drive less the known load",
    "known_torque": "N m, torque of further effects",
    "omega": "rad/s, speed from the last two angles",
    "direction": "1, sign of the speed",
    "friction": "N m, estimated friction at the present speed",
    "moved": "rad, angle turned since the last valid sample",
    "ahead": "rad, angle turned beyond that at the last speed",
    "take_friction": "N m, estimated friction at the present speed",
    "take_direction": "1, sign of the speed",
    "take_y": "rad or rad/s, innovation",
    "take_S": "rad^2 or (rad/s)^2, its variance",
    "take_event": "number of the event, as the output",
    "adapt_apart": "1, difference of two normalised innovations",
    "adapt_innovation": "1, normalised innovation",
    "acceleration_alpha": "rad/s^2, mean acceleration over the step",
    "acceleration_bend": "1/(kg m^2) s, half the step over the inertia",
    "acceleration_by_F_v": "rad/s^2 per N m s/rad, derivative of the acceleration by F_v",
    "acceleration_middle": "rad/s, speed in the middle of the step",
    "acceleration_per_J": "1/(kg m^2), reciprocal of the inertia",
    "acceleration_rest": "N m, torque without viscous friction",
    "acceleration_share": "1/(kg m^2), derivative of the acceleration by a torque",
    "acceleration_slope": "N m s/rad, viscous friction",
    "classify_ending": "whether a motion ends with this sample",
    "classify_floor": "rad/s, below it the axis counts as standing",
    "classify_last": "rad/s, speed of the last sample",
    "classify_onward": "whether the axis moves on in its direction",
    "classify_reach": "N m s, change of momentum that the torque can cause",
    "classify_seen": "1 if the last speed is known, else 0",
    "classify_speed": "rad/s, measured speed",
    "classify_change": "rad/s, change of speed beyond its noise",
    "depart_away": "N m, distance of the torque from its running mean",
    "depart_departure": "(N m)^2, its square beyond the noise",
    "classify_apart": "rad/s, distance of the speed from its mean",
    "classify_weight": "1, weight of this sample in the running means",
    "constant_speed_limit": "rad/s, spread below which the speed is constant",
    "fresh_speed_dt": "s, time step",
    "fresh_speed_lag": "s, age of the measured speed",
    "fresh_speed_shared": "rad^2/s, covariance of speed and angle",
    "fresh_speed_spread": "rad/s, uncertainty from a change of the torque",
    "fresh_speed_variance": "(rad/s)^2, variance of the speed",
    "advance_room": "variance left up to the prior one, square of the unit of the state",
    "innovation_variance_S": "rad^2 or (rad/s)^2, variance of the innovation",
    "keep_past_speed_speed": "rad/s, mean speed since the last update",
    "keep_split_level": "rad or rad/s, effect of F_c and F_v on the measurement",
    "keep_split_share": "1, common relative change of F_c and F_v",
    "predict_a_omega": "1, change of the predicted speed with the speed",
    "predict_aa": "(rad/s)^2, variance of the predicted speed",
    "predict_ab": "rad^2/s, covariance of predicted speed and angle",
    "predict_bb": "rad^2, variance of the predicted angle",
    "predict_dt": "s, time step",
    "predict_half": "s, half of the time step",
    "predict_per_J": "1/(kg m^2), reciprocal of the inertia",
    "predict_q": "(rad/s)^2, variance that the torque's noise adds",
    "predict_u_omega": "(rad/s)^2, part of the variance of the predicted speed",
    "predict_u_theta": "rad^2/s, part of the covariance of the angle",
    "predict_v_omega": "rad^2/s, part of the covariance of the angle",
    "predict_v_theta": "rad^2, part of the variance of the angle",
    "process_variance_surge": "N m s, change of torque times the step",
    "process_variance_value": "(N m s)^2, variance by a step of the torque",
    "process_variance_instant": "(N m s)^2, variance by the unknown instant of a step of the torque",
    "process_variance_late": "(N m s)^2, variance by a torque logged late",
    "process_variance_white": "(N m s)^2, variance by the torque's noise",
    "restart_shared": "rad^2/s, covariance of speed and angle",
    "restart_variance": "(rad/s)^2, variance of the speed",
    "measure_value": "rad or rad/s, predicted measurement",
    "measure_lag": "s, lag of the measured speed",
    "update_S": "rad^2 or (rad/s)^2, variance of the innovation",
    "update_innovation": "rad or rad/s, innovation as judged",
    "update_variance": "rad^2 or (rad/s)^2, its variance as judged",
    "update_y": "rad or rad/s, innovation",
    "update_event": "number of the event, as the output",
}
# the same variable in several functions: the end of its name
NOTES |= {
    f"{function}_{text}": meaning
    for function in ("predict", "measure", "restart", "update")
    for text, meaning in {
        "alpha": "rad/s^2, acceleration",
        "d_omega": "1/s, derivative of the acceleration by the speed",
        "d_c": "rad/s^2 per N m, derivative of the acceleration by F_c",
        "d_v": "rad/s^2 per N m s/rad, derivative of the acceleration by F_v",
        "d_load": "rad/s^2 per N m, derivative of the acceleration by T_load",
        "d_J": "rad/s^2 per kg m^2, derivative of the acceleration by J",
        "direction": "1, sign of the speed",
    }.items()
}

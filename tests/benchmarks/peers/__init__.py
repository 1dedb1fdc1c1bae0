"""Other sparse fits on the same logs as the diagnosis: what they name where nothing is hidden, and where something is.

Compared are PySINDy's STLSQ, SysIdentPy's FROLS and a greedy forward selection by Schwarz's criterion with
`pmsm_ctrl.diagnose`, on drives drawn at random (`tests.benchmarks.worlds`) and on EMPS.

What every peer gets, so that none loses by anything but its choice:

- The torque of the log on the grid, in the band and with the weights of the diagnosis, and motion differentiated by
  it. The current inside a column is that of the base model, since one made of the measured torque explains its noise.
- Inertia, Coulomb and viscous friction, and the nuisances of the diagnosis's base model, without competition: they are
  in every model, and the columns are standardised after their share of them is gone.
- The columns that the first round of the diagnosis tries: one group for each effect of the catalogue that enters the
  torque, its nonlinear parameters where that round finds them best. No peer has to search.
- A second, generic library where that is of use: products of speed, direction, acceleration, sin and cos of the angle
  up to the second degree, of speed and direction up to the third. Products that are an effect carry its name.

How each chooses: STLSQ by its threshold, cross-validated on five contiguous blocks of time, the largest threshold
within one standard error of the least error; FROLS by its information criterion, BIC; the greedy selection by BIC with
columns of an effect together and searched parameters paid for. What was left to choose (one standard error or the least
error; BIC or AICc) was chosen on seeds 300 to 399; judged are seeds 400 to 699.

How they are judged: a name is an effect beyond inertia, Coulomb and viscous friction. A constant offset is right where
a constant load is hidden, and no false name elsewhere, for the peers and for the diagnosis. Voltages are taken out of
all logs: the peers fit one balance, the torque's. A log that a method fails on is a row with its reason, and no hit.
The held-out record is of the same drive with the same effect: another draw of the same kind of motion, and of noise.

mujoco's `sysid` is not among them: it fits the parameters that a user declares in a given model to trajectories, with
confidence intervals, and has no step that adds or drops a term. It cannot name a missing effect, rightly or falsely. On
EMPS it finds the four parameters of the base model, for their errors beside those of the others.
"""

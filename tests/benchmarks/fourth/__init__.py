"""A fourth simulator, written by somebody who knew what the diagnosis answers and not how it decides.

Nothing of the package is used until the log lies on the disk beside its design. `axis.c` is the axis and its drive,
`motions.py`, `world.py` and `recorder.py` what is drawn, `effects.py` and `others.py` what is hidden, `cases.py` one
log of a seed, `regression.py` how far the effect stands above the noise, `judge.py` the command and its figures.
"""

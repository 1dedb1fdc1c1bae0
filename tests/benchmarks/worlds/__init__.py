"""A third simulator whose every log draws its own world: drive, motor, sampling, motion and noise at random.

Nothing of `pmsm_ctrl.simulate` or of the effects is used. See `world.py` for what is drawn, `plant.py` for the drive,
`recorder.py` for how it is logged, `judge.py` for the figures.
"""

"""The words of a study's notices, each with its code."""

from pmsm_ctrl.section import Template

__all__ = ["LEFT_OUT", "NOT_VALIDATED"]

LEFT_OUT = Template("left_out", "not done: {what}, because {why}")
NOT_VALIDATED = Template("not_validated", "this effect has not been validated")

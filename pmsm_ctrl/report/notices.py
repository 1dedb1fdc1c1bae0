"""The words of a study's notices, each with its code."""

from pmsm_ctrl.section import Template

__all__ = ["LEFT_OUT", "NOT_VALIDATED", "NO_SIGNATURE"]

LEFT_OUT = Template("left_out", "not done: {what}, because {why}")
NO_SIGNATURE = Template("no_signature", "the signature is left out: the design has no loops to simulate it with")
NOT_VALIDATED = Template("not_validated", "this effect has not been validated")

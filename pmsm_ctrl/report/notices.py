"""The words of a study's notices, each with its code."""

from pmsm_ctrl.section import Template

__all__ = ["LEFT_OUT"]

LEFT_OUT = Template("left_out", "not done: {what}, because {why}")

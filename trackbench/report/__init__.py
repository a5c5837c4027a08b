"""Tables and figures, from the files of a results folder and nothing else."""

DRAWER = "trackbench.report.drawing_process"
"""What a process that draws figures imports."""

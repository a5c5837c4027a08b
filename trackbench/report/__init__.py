"""Floor 5: tables and figures, from the files of a results folder and nothing else."""

DRAWER = "trackbench.report.drawer"
"""What a process that draws figures imports."""

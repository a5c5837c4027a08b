"""Tables and figures, from the files of a results folder and nothing else."""

"""Floor 2: one file per filter or close family, each reading like its paper. Never imports scenarios."""

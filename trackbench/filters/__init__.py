"""One file per filter or close family, each reading like its paper. Never imports scenarios."""

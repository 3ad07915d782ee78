"""Contact laws for other programs: what the pipeline found, as they read it."""

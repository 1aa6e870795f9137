"""Reports of experiments and demo."""

"""Report of the demo: terminal, page and plots."""

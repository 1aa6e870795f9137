"""Report of a weighing: terminal, page and figures."""

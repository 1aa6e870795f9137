"""Report of an excitation: terminal, page and figures."""

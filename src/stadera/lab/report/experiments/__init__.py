"""Report of reproduced experiments: terminal, page and figures."""

"""Report of an identification: terminal, page and plots."""

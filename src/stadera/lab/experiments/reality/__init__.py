"""Study of robots that differ from their model files: runs with `real` errors, and their evaluation."""

"""The `real` errors of the test-bed: differences between robots and their model files, drawn for each run."""

"""Named runs of the test-bed, as logs for the rest of the package."""
